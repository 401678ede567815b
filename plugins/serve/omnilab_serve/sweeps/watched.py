"""Sweeps that somebody looks at: of each only what has changed since is read."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from omnilab.client import JobRecord, SweepRecord
from omnilab.runner.sweeps import Job
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.snapshot import Snapshot, snapshot
from omnilab_serve.index.records import encodable, stage_progress
from omnilab_serve.index.sweep_records import sweep_record

KEPT = 16  # readers


class WatchedSweeps:
    """A reader a sweep, of those that were looked at last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._readers: OrderedDict[Path, tuple[SweepReader, threading.Lock]] = OrderedDict()

    def snapshot(self, folder: Path) -> Snapshot:
        """How a sweep stands now; DataError if there is none in the folder."""
        with self._lock:
            reader, turn = self._readers.setdefault(folder, (SweepReader(folder), threading.Lock()))
            self._readers.move_to_end(folder)
            while len(self._readers) > KEPT:
                self._readers.popitem(last=False)
        with turn:
            return snapshot(reader.load())


def sweep_with_jobs(seen: Snapshot, path: Callable[[Path], str]) -> SweepRecord:
    """A sweep and all its jobs; `path`: of a folder, below the logs."""
    sweep = sweep_record(seen, path(seen.sweep.folder))
    return replace(sweep, jobs=[_job_record(seen, job, sweep.path) for job in seen.sweep.jobs])


def _job_record(seen: Snapshot, job: Job, sweep: str) -> JobRecord:
    below = job.folder.relative_to(seen.sweep.folder).as_posix()
    return JobRecord(
        job.number,
        job.state,
        encodable(job.overrides),
        None if job.state == "planned" else f"{sweep}/{below}",
        {name: value if math.isfinite(value) else None for name, value in job.metrics.items()},
        encodable(job.error),
        seen.seconds(job),
        stage_progress(seen.progress.get(job.number)),
    )
