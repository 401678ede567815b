"""Results of a study, and the recorder that it logs to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy.typing as npt

from omnilab.api.data import Places, T
from omnilab.api.records import Record, Tick


@dataclass(frozen=True)
class Metric:
    """One measured figure. Nothing in it may depend on the clock."""

    name: str
    value: float
    unit: str  # "1" for ratios and counts
    interval: tuple[float, float] | None = None  # 95 % confidence, where it was estimated
    note: str = ""  # why there is no value, where it is NaN, in a few words


@dataclass(frozen=True)
class Report:
    """The results of a study. Tables of runs show the first three metrics."""

    metrics: Sequence[Metric]
    tables: Mapping[str, Mapping[str, Sequence[Any] | npt.NDArray[Any]]] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)  # matplotlib figures, by file name without ending
    map: Places | None = None  # to be kept, so that other runs can localise in it
    files: Mapping[str, str] = field(default_factory=dict)  # texts by file name: trajectories, graphs
    summary: str = ""  # Markdown; the runner logs it as `summary`
    omitted: Sequence[str] = ()  # what was left out, each with its reason; the runner logs them as lines of `log`


@dataclass(frozen=True)
class RunResult:
    """How a run ended."""

    status: str  # done, failed or interrupted
    metrics: Sequence[Metric] = ()  # those that were computed
    error: str = ""  # kind and message of the error that ended it
    traceback: str = ""  # where the error is a bug


@runtime_checkable
class TakesResult(Protocol):
    """A sink that writes down how the run ended has this method, too."""

    def conclude(self, result: RunResult) -> None:
        """The run has ended, the folder holds what it has written of its results: the last call before `close`."""


class Recorder(Protocol):
    """The log of a run, as a study sees it: records, progress, times."""

    def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
        """Hand one record to every sink. Without a tick it holds for the whole run."""

    def track(self, items: Iterable[T], stage: str, total: int, size: Any = None) -> Iterator[T]:
        """Pass `items` on, telling the sinks after each how far the stage is (`size` of an item counts its parts).

        Without it, batches such as `Frames` count as many as they hold, and items that have no length as one.
        """

    def aside(self) -> AbstractContextManager[Callable[[Callable[[], object]], object]]:
        """A thread that makes and logs records while the study goes on: it is handed actions, which it runs in order."""

    def timed(self, stage: str, count: int = 1) -> AbstractContextManager[None]:
        """Measure the wall time of a stage over `count` items; the sums land in the run's cost table."""
