"""Writes how far a run has come into its folder, from a thread of its own: a slow or full disk delays and ends nothing."""

from __future__ import annotations

import logging
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple, Self

from omnilab.api import Progress
from omnilab.atomic_files import write_whole
from omnilab.runner.run_folder.names import PROGRESS
from omnilab.runner.run_folder.progress import RunProgress

EVERY_S = 1.0  # how often it is written within a stage
SOONEST_S = 0.2  # after the last time, at a change of stages
SHARE = 1000  # so many times what writing it cost passes until it is written again: 0.1 % of a run
MEASURED_S = 1.0  # of work, before its end is estimated
JOIN_S = 2.0  # how long the end of a run waits for the disk
LONGEST, MOST_STAGES, MOST = 100, 50, 2**53  # characters of a stage's name, names of stages, items

log = logging.getLogger("omnilab")


class _Stage(NamedTuple):
    """Where a stage is, and where it was when its first items were done: those load and compile."""

    progress: Progress
    now_s: float
    first: int
    first_s: float

    def after(self, progress: Progress, now_s: float) -> _Stage:
        if progress.stage != self.progress.stage or progress.done < self.progress.done or self.first == 0:
            return _Stage(progress, now_s, progress.done, now_s)
        return self._replace(progress=progress, now_s=now_s)

    @property
    def left_s(self) -> float | None:
        """Time to its end, by the pace since its first items; None: not known."""
        left, items = self.progress.total - self.progress.done, self.progress.done - self.first
        seconds = self.now_s - self.first_s
        if left == 0 < self.progress.total:
            return 0.0
        return left * seconds / items if left > 0 and items > 0 and seconds >= MEASURED_S else None


class ProgressFile:
    """`progress.json` of a run, from when it is entered until it is left; the last state stays."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / PROGRESS
        self._stage = _Stage(Progress("", 0, 0), 0.0, 0, 0.0)
        self._finished: dict[str, None] = {}
        self._began, self._began_s = datetime.now(UTC), time.monotonic()
        self._failed = False
        self._wanted, self._ends = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._keep_written, name="omnilab-progress", daemon=True)

    def note(self, progress: Progress) -> None:
        """A stage has come so far. Takes microseconds: what it costs to write is the thread's business."""
        try:
            done, total = (min(max(0, int(count)), MOST) for count in (progress.done, progress.total))
        except (TypeError, ValueError, OverflowError):  # no counts: nothing that could be written
            return
        counted = Progress(str(progress.stage)[:LONGEST], done, total)
        before, self._stage = self._stage, self._stage.after(counted, time.monotonic())
        if done == total > 0:
            self._finished[counted.stage] = None
        if counted.stage != before.progress.stage:
            self._wanted.set()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._wanted.set()
        self._thread.join(JOIN_S)

    def _keep_written(self) -> None:
        written = None
        while True:
            self._wanted.clear()
            last, stage, cost_s = self._ends.is_set(), self._stage, 0.0
            if stage is not written:
                cost_s, written = self._write(stage), stage
            if last:
                return
            pause_s = SHARE * cost_s
            self._ends.wait(max(SOONEST_S, pause_s))
            self._wanted.wait(max(0.0, EVERY_S - max(SOONEST_S, pause_s)))

    def _write(self, stage: _Stage) -> float:
        """Write where the run is, if it can be; processor time that it took, in seconds."""
        start_s = time.thread_time()
        now = RunProgress(
            stage.progress.stage, stage.progress.done, stage.progress.total, stage.left_s,
            tuple(self._finished)[-MOST_STAGES:], time.monotonic() - self._began_s,
            self._began.isoformat(), datetime.now(UTC).isoformat(),
        )  # fmt: skip
        try:
            write_whole(self._file, lambda out: out.write(now.to_json().encode()))
        except OSError as error:  # a full disk, or the folder was removed: whoever looks sees what was written last
            if not self._failed:
                log.info("%s cannot be written (%s)", PROGRESS, error.strerror)
            self._failed = True
        return time.thread_time() - start_s
