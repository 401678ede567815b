"""A run as its page shows it. What its folder does not say is empty; what is damaged is said, and costs nothing else."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from omnilab.client import LogTail, RunFile, RunRecord
from omnilab.errors import DataError
from omnilab.runner.run_folder import (
    FAILED,
    INTERRUPTED,
    KILLED,
    RUNNING,
    SILENT,
    UNREADABLE,
    WARNINGS,
    LoadedRun,
)
from omnilab.runner.terminal import short
from omnilab_serve.run_details.files import MOST_FILES, RECORDING, run_files
from omnilab_serve.run_details.log_text import LogPassage, log_tail, passages
from omnilab_serve.run_details.queries import worst_queries

WORST = "worst.png"
LAST_LINES = 12  # of the log, above all else of a run that failed
DIGITS = 16  # of an identity that are shown
T = TypeVar("T")


@dataclass(frozen=True)
class UsedComponent:
    """A component that a run was made of."""

    slot: str
    name: str
    distribution: str
    version: str


@dataclass(frozen=True)
class RunDetails:
    """One run: its record, and what else its folder holds."""

    run: LoadedRun
    record: RunRecord
    most_files = MOST_FILES

    @property
    def failed(self) -> bool:
        return self.record.state in (FAILED, UNREADABLE)

    @cached_property
    def files(self) -> Sequence[RunFile]:
        return run_files(self.run.folder)

    @cached_property
    def figures(self) -> Sequence[RunFile]:
        """Its pictures, but for that of the worst queries."""
        return [
            file for file in self.files if file.name.endswith(".png") and "/" not in file.name and file.name != WORST
        ]

    @cached_property
    def has_worst_picture(self) -> bool:
        return any(file.name == WORST for file in self.files)

    @cached_property
    def worst(self) -> Sequence[Mapping[str, str]]:
        return worst_queries(self.run.folder)

    @property
    def has_recording(self) -> bool:
        """Whether there is a recording, or is going to be one."""
        sinks = [name for slot, name in self.record.components.items() if slot.startswith("sinks.")]
        return any(file.name == RECORDING for file in self.files) or (self.record.state == RUNNING and "rerun" in sinks)

    @cached_property
    def notes(self) -> Mapping[str, str]:
        """Why metrics have no value."""
        return _known(lambda: self.run.notes, {})

    @cached_property
    def log(self) -> LogTail:
        return log_tail(self.run.folder)

    @property
    def log_passages(self) -> Sequence[LogPassage]:
        return passages(self.log.lines)

    @property
    def last_words(self) -> str:
        """The end of the log of a run that failed, with its last traceback whole."""
        found = self.log_passages
        if any(passage.is_traceback for passage in found[-2:]):
            return "\n".join(passage.text for passage in found[-2:])
        return "\n".join(self.log.lines[-LAST_LINES:])

    @cached_property
    def warnings(self) -> Sequence[str]:
        """What is to be known before the metrics are believed."""
        return _known(lambda: self.run.parsed(WARNINGS, str.splitlines), [])

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        return _known(lambda: self.run.manifest, {})

    @property
    def components(self) -> Sequence[UsedComponent]:
        named = _mapping(self.manifest.get("components"))
        return [UsedComponent(slot, *(str(_mapping(about).get(key, "")) for key in ("name", "distribution", "version")))
                for slot, about in named.items()]  # fmt: skip

    @property
    def versions(self) -> Mapping[str, str]:
        """What it ran with and on."""
        host = _mapping(self.manifest.get("host"))
        system = ", ".join(str(host[key]) for key in ("name", "system") if host.get(key))
        cores = f", {host['cores']} cores" if host.get("cores") else ""
        found = {
            "Host": system + cores, "Python": self.manifest.get("python"), "Commit": self.manifest.get("commit"),
            "Seed": self.manifest.get("seed"), "Identity": str(self.manifest.get("identity", ""))[:DIGITS],
            "Run": self.manifest.get("id"),
        }  # fmt: skip
        return {name: str(value) for name, value in found.items() if value not in (None, "")}

    @property
    def plugins_failed(self) -> Sequence[str]:
        return _texts(self.manifest.get("plugins_failed"))

    @property
    def command(self) -> str:
        """That made it."""
        return shlex.join(_texts(self.manifest.get("command")))

    @property
    def repeat(self) -> str:
        """The command that repeats it; "" where there are no results to be the same."""
        return self._call("repeat") if self.record.metrics and self.components else ""

    @property
    def advice(self) -> tuple[str, str]:
        """What became of a run that did not end as it should, and the command that helps: "" where none does."""
        state = self.record.state
        if state == KILLED:
            return "Its process was killed. What it had logged is there; this mends the logs:", self._call("repair")
        if state == SILENT:
            silent = f"{self.run.lock.sentence(self.run.folder)}. Once it has ended there, this mends its logs:"
            return silent, self._call("repair", "--ended")
        if state == UNREADABLE:
            return "What can be read of it is shown. This mends its logs:", self._call("repair")
        return ("It was interrupted; what it had logged is there.", "") if state == INTERRUPTED else ("", "")

    def _call(self, name: str, *options: str) -> str:
        return shlex.join(["omnilab", name, *options, str(short(self.run.folder))])


def _known(part: Callable[[], T], otherwise: T) -> T:
    """A part of a run's folder; `otherwise` where it is damaged or was never written."""
    try:
        return part()
    except DataError:
        return otherwise


def _mapping(content: object) -> Mapping[str, Any]:
    return content if isinstance(content, dict) else {}


def _texts(content: object) -> list[str]:
    return [str(word) for word in content] if isinstance(content, list) else []


def figure_title(name: str) -> str:
    """The name of a picture's file as words: `error_map.png` is "Error map"."""
    words = Path(name).stem.replace("_", " ")
    return words[:1].upper() + words[1:]
