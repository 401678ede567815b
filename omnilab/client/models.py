"""What the service answers and is asked, as the API has it in JSON. Times are ISO 8601, by the clock of the run's host."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Session:
    """What a client needs before it asks for changes."""

    version: str  # of omnilab, that answers
    csrf: str  # the header X-CSRF-Token of requests that change something


@dataclass(frozen=True)
class StageProgress:
    """How far a run, or a sweep, is."""

    fraction: float  # of the stage, from 0 to 1
    words: str  # "43 % (queries 86 of 200)"
    left_s: float | None = None  # of the stage; None: not known


@dataclass(frozen=True)
class RunRecord:
    """A run, as a row of a table has it. What its folder does not say is empty."""

    path: str  # of its folder, below the logs, with /
    state: str  # running, done, failed, interrupted, killed, silent or unreadable
    experiment: str = ""
    overrides: Sequence[str] = ()  # but for experiment=
    components: Mapping[str, str] = field(default_factory=dict)  # by slot, such as `descriptor`, the registered name
    settings: Mapping[str, Any] = field(default_factory=dict)  # all, by full names such as `study.step_m`
    metrics: Mapping[str, float | None] = field(default_factory=dict)  # None: there is no value
    intervals: Mapping[str, Sequence[float]] = field(default_factory=dict)  # 95 % confidence, low and high
    units: Mapping[str, str] = field(default_factory=dict)
    started: str | None = None
    seconds: float | None = None  # that it took, or has taken
    host: str | None = None
    error: str | None = None
    sweep: str | None = None  # the path of the sweep that it is a job of
    progress: StageProgress | None = None  # of one that is running


@dataclass(frozen=True)
class RunFile:
    """A file of a run's folder."""

    name: str  # its path below the folder, with /
    size: int  # bytes
    changed: str


@dataclass(frozen=True)
class LogTail:
    """The end of a run's log."""

    lines: Sequence[str] = ()
    size: int = 0  # of the whole log, bytes
    cut: bool = False  # there are lines before


@dataclass(frozen=True)
class RunPage:
    """Some of the runs that a query matches, in its order."""

    total: int  # that it matches
    runs: Sequence[RunRecord] = ()


@dataclass(frozen=True)
class JobRecord:
    """A job of a sweep."""

    number: int
    state: str  # planned, or as of a run
    overrides: Sequence[str] = ()
    path: str | None = None  # of its run folder, below the logs; None where there is none yet
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    error: str | None = None
    seconds: float | None = None
    progress: StageProgress | None = None


@dataclass(frozen=True)
class SweepRecord:
    """A sweep, without or with its jobs."""

    path: str  # of its folder, below the logs, with /
    state: str  # running, silent, done, failed, interrupted (jobs are still to be done) or unreadable
    experiment: str = ""
    command: Sequence[str] = ()
    parameters: Mapping[str, Sequence[str]] = field(default_factory=dict)  # what is swept, and its values
    counts: Mapping[str, int] = field(default_factory=dict)  # of jobs, by state
    goes_on: bool = False
    fraction: float = 0.0
    left_s: float | None = None
    started: str | None = None
    error: str | None = None  # why it is unreadable
    jobs: Sequence[JobRecord] = ()


@dataclass(frozen=True)
class SubmissionRequest:
    """What is to be run: overrides as on the command line, one a word, checked by Hydra's grammar."""

    overrides: Sequence[str]  # with experiment=NAME among them; comma values make a sweep
    priority: int = 0  # the larger, the sooner
    launcher: str = "basic"  # of a sweep: basic, joblib, submitit_local, submitit_slurm, ray


@dataclass(frozen=True)
class Submission:
    """Something in the queue, or that was."""

    id: str
    state: str  # queued, running, done, failed, cancelled, killed, interrupted
    overrides: Sequence[str]
    priority: int = 0
    launcher: str = "basic"
    sweep: bool = False
    path: str | None = None  # of the folder of its run or sweep, below the logs; None before it began
    attempt: int = 0  # how often it was begun
    submitted: str = ""
    started: str | None = None
    ended: str | None = None
    error: str | None = None
    experiment: str = ""
    jobs: int = 1
    command: str = ""  # that does the same on a command line
    stopping: int = 0  # how often it was told to end: by SIGINT, then SIGTERM, then SIGKILL
    folders: Sequence[str] = ()  # of each time that it was begun, below the logs
    progress: StageProgress | None = None  # of one that is running


@dataclass(frozen=True)
class ComponentRecord:
    """A component that is installed."""

    kind: str
    name: str
    summary: str
    manual: str  # its docstring
    distribution: str
    version: str
    settings: Sequence[Mapping[str, Any]] = ()  # as `omnilab plugins --json` has them


@dataclass(frozen=True)
class PluginFailure:
    """A plugin that could not be loaded."""

    plugin: str  # with its distribution and version
    sentence: str
    traceback: str


@dataclass(frozen=True)
class RecipeRecord:
    """An experiment that is shipped."""

    name: str
    summary: str  # the first line of its comment
    notes: str = ""  # the further ones


@dataclass(frozen=True)
class CheckedRequest:
    """What is asked to be run, as the builder accepts it."""

    experiment: str
    jobs: int  # 1: a run; more: a sweep
    command: Sequence[str]  # the words of `omnilab`, without where it writes
    swept: Mapping[str, Sequence[str]] = field(default_factory=dict)  # the values of what a sweep varies
