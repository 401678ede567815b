"""A sink: what was measured along the run, as lines of JSON."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from omnilab import (
    Record,
    RunResult,
    Series,
    Sink,
    Text,
    Tick,
    setting,
)


@dataclass
class MySink:
    """Writes curves, the lines of the log and the metrics as lines of JSON.

    Other records have no form here and are left out. A program that reads the file while
    the run goes on has all but the last half second.
    """

    file: str = setting("my_sink.jsonl")  # its name in the run's folder

    def __post_init__(self) -> None:
        self._out: IO[str] | None = None

    def open(self, folder: Path) -> None:
        """Begin the file in the run's folder."""
        self._out = (folder / self.file).open("w", encoding="utf-8")

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Take one record."""
        if isinstance(record, Series):
            steps, values = record.steps.tolist(), record.values.tolist()
            for step, value in zip(steps, values, strict=True):
                self._line(path=path, step=step, value=value, unit=record.unit)
        elif isinstance(record, Text):
            step = None if tick is None else tick.step
            self._line(path=path, step=step, text=record.text, level=record.level)

    def conclude(self, result: RunResult) -> None:
        """The run has ended: its metrics, or its error."""
        for metric in result.metrics:
            self._line(metric=metric.name, value=float(metric.value), unit=metric.unit)
        self._line(status=result.status, error=result.error)

    def flush(self) -> None:
        """What was taken survives the death of the process from here on."""
        if self._out is not None:
            self._out.flush()

    def close(self) -> None:
        """Complete the file."""
        if self._out is not None:
            self._out.close()
            self._out = None

    def repair(self, folder: Path) -> str | None:
        """Cut off a last line that the death of the process left unfinished."""
        file = folder / self.file
        if not file.is_file():
            return None
        with file.open("rb+") as torn:
            data = torn.read()
            whole = data.rfind(b"\n") + 1
            if whole == len(data):
                return None
            torn.seek(whole)
            torn.truncate()
            os.fsync(torn.fileno())
        return f"{self.file}: an unfinished line was cut off"

    def _line(self, **values: object) -> None:
        assert self._out is not None, "records come between open and close"
        self._out.write(json.dumps(values) + "\n")  # NaN as Python's json reads it


# a type checker compares it with the contract:
_: type[Sink] = MySink
