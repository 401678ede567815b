"""A plugin whose sink notes, outside the run's folder and without a buffer, which records were logged and when."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from omnilab.api import Estimate, Image, Pose, Record, Series, Signature, Tick
from omnilab.hooks import hookimpl

VARIABLE = "TORTURE_WITNESS"  # names its file
SINK = "+sink@sinks.witness=witness"  # after the logs': what is noted was handed to them


@dataclass
class Witness:
    """A line for each record that has steps: time in ns, path, step, the run's folder."""

    def open(self, folder: Path) -> None:
        """Open the file."""
        self._folder = folder.resolve()
        self._file = os.open(os.environ[VARIABLE], os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Note one record, or the rows of one."""
        steps: list[int] = []
        if isinstance(record, Series):
            steps = [int(step) for step in record.steps]
        elif tick is not None and isinstance(record, Image | Signature | Estimate | Pose):
            steps = [tick.step]
        now = time.time_ns()
        os.write(self._file, "".join(f"{now} /{path.strip('/')} {step} {self._folder}\n" for step in steps).encode())

    def flush(self) -> None:
        """Nothing is kept back."""

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def repair(self, folder: Path) -> str | None:
        """There is nothing to mend."""
        return None


@hookimpl
def register_sinks(register):
    """For `OMNILAB_PLUGINS`."""
    register("witness", Witness)


def noted(file: Path, folder: Path) -> list[tuple[int, str, int]]:
    """Time in ns, path and step of all that a witness noted of the run in a folder."""
    lines = file.read_text().split("\n")[:-1] if file.exists() else []
    rows = (line.split(" ", 3) for line in lines)
    return [(int(time_ns), path, int(step)) for time_ns, path, step, run in rows if Path(run) == folder.resolve()]
