"""A submission on the disk: one small JSON file, which is the truth about it."""

from __future__ import annotations

import json
import math
import re
import shlex
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from types import NoneType
from typing import Any, Self

from omnilab.atomic_files import write_whole
from omnilab.client import Submission
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder import DONE, FAILED, INTERRUPTED, KILLED, RUNNING
from omnilab.runner.run_folder.lock import Holder

QUEUED, CANCELLED = "queued", "cancelled"  # besides the states of a run
ACTIVE = (QUEUED, RUNNING)
STATES = (*ACTIVE, DONE, FAILED, INTERRUPTED, KILLED, CANCELLED)
MOST_PRIORITY = 1000
LARGEST_BYTES = 1 << 22
LONGEST_ERROR = 2000  # characters
IDENTITY = re.compile(r"[0-9a-f]{12}")
TEXT, TEXTS = (str, NoneType), (list,)


def now() -> str:
    """The time, as files have it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@dataclass(frozen=True)
class Attempt:
    """Once that a submission was begun."""

    path: str  # of the folder of its run or sweep, below the logs
    time: str
    process: Holder | None = None  # None until it is known: the file was written before the process was started

    @classmethod
    def of(cls, content: Any) -> Self:
        """KeyError, TypeError or ValueError if this is not what a file says of a start."""
        path, time_, process = content["path"], content["time"], content["process"]
        if datetime.fromisoformat(time_).tzinfo is None:
            raise ValueError("a start has a time of no zone")
        _check_within(path)
        return cls(path, time_, Holder.of(process) if isinstance(process, dict) else None)


def _check_within(path: str) -> None:
    """ValueError for a path that leads out of the logs."""
    parts = PurePosixPath(path).parts
    if not parts or parts[0] == "/" or ".." in parts:
        raise ValueError("it has a folder outside of the logs")


@dataclass(frozen=True)
class SubmissionFile:
    """What the file of a submission says."""

    id: str
    overrides: list[str]  # as they were requested
    words: list[str]  # of the command, as they were checked, without where it writes
    directory: str  # in which it is run: from there files are named
    logs: str  # where they were: a copy elsewhere runs nothing by itself
    machine: str | None
    experiment: str = ""
    jobs: int = 1
    priority: int = 0
    launcher: str = "basic"
    sweep: bool = False
    resumes: str | None = None  # the path of a sweep that was begun elsewhere, of which the own file has the command
    retry_failed: bool = False  # jobs of a sweep that failed are run again
    state: str = QUEUED
    submitted: str = field(default_factory=now)
    queued_s: float = field(default_factory=time.time)  # its place among those of its priority
    starts: list[Attempt] = field(default_factory=list)
    restarts: int = 0  # how often it was begun again because its process had gone, since it was last requested
    signals: int = 0  # how often it was told to end, since it was last requested
    ended: str | None = None
    error: str | None = None

    @property
    def path(self) -> str | None:
        """Of the folder of its run or sweep, below the logs; None before it was begun."""
        return self.starts[-1].path if self.starts else self.resumes

    @property
    def mark(self) -> str:
        """What the environment of its last process, and the name of its output, say."""
        return f"{self.id}-{len(self.starts)}"

    @property
    def order(self) -> tuple[float, float]:
        """What is smaller is begun sooner."""
        return -self.priority, self.queued_s

    def write(self, folder: Path) -> None:
        """Replace the file in the queue's folder, whole; DataError if the disk does not take it."""
        text = json.dumps(asdict(self), indent=1) + "\n"
        if len(text) > LARGEST_BYTES:
            raise DataError(f"the words of the command have more than {LARGEST_BYTES} characters; give fewer")
        try:
            write_whole(folder / f"{self.id}.json", lambda out: out.write(text.encode()))
        except OSError as error:
            raise DataError(f"{error.filename} cannot be written ({error.strerror}); make room there") from error

    def public(self) -> Submission:
        """As pages and API have it."""
        return Submission(
            self.id, self.state, self.overrides, self.priority, self.launcher, self.sweep, self.path, len(self.starts),
            self.submitted, self.starts[-1].time if self.starts else None, self.ended, self.error,
            experiment=self.experiment, jobs=self.jobs, command=self.command(), stopping=self.signals,
            folders=[start.path for start in self.starts],
        )  # fmt: skip

    def command(self) -> str:
        """What does the same on a command line."""
        if self.resumes:
            more = ["--retry-failed"] if self.retry_failed else []
            return shlex.join(["omnilab", "sweep", "resume", f"{self.logs}/{self.resumes}", *more])
        return shlex.join(["omnilab", *self.words])


TYPES: Mapping[str, tuple[type, ...]] = {
    "id": (str,), "overrides": TEXTS, "words": TEXTS, "directory": (str,), "logs": (str,), "machine": TEXT,
    "experiment": (str,), "jobs": (int,), "priority": (int,), "launcher": (str,), "sweep": (bool,), "resumes": TEXT,
    "retry_failed": (bool,), "state": (str,), "submitted": (str,), "queued_s": (int, float), "starts": (list,),
    "restarts": (int,), "signals": (int,), "ended": TEXT, "error": TEXT,
}  # fmt: skip


def check_priority(priority: int) -> None:
    """ConfigError for one beyond all others."""
    if abs(priority) > MOST_PRIORITY:
        raise ConfigError(f"priority={priority} is out of range; give {-MOST_PRIORITY} to {MOST_PRIORITY}")


def read_submission(file: Path) -> SubmissionFile:
    """The submission of a file, which may be damaged, or a stranger's: DataError then."""
    try:
        content = json.loads(content_of(file, LARGEST_BYTES))
        found = {each.name: content[each.name] for each in fields(SubmissionFile)}
        wrong = [name for name, types in TYPES.items() if type(found[name]) not in types]
        wrong += [name for name in ("jobs", "signals", "restarts") if not wrong and not 0 <= found[name] < 10**9]
        wrong += [] if found["state"] in STATES else ["state"]
        texts = all(isinstance(word, str) for word in (*found["overrides"], *found["words"]))
        if wrong or not texts or not math.isfinite(found["queued_s"]):
            raise ValueError(f"its {wrong[0] if wrong else 'words or its time'} cannot be")
        if found["id"] != file.stem or not IDENTITY.fullmatch(file.stem):
            raise ValueError("its id is not its name")
        _check_within(found["resumes"] or "none")
        check_priority(found["priority"])
        found["starts"] = [Attempt.of(start) for start in found["starts"]]
        if found["state"] == RUNNING and not found["starts"]:
            raise ValueError("it says running, and was never begun")
        return SubmissionFile(**found)
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError, ConfigError) as error:
        why = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise DataError(f"{file} cannot be read ({why}); it is left alone: move it away") from error
