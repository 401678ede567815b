"""How a sweep stands at one instant: its jobs, how far those that run are, and the time that is left."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property

from omnilab.runner.run_folder import process
from omnilab.runner.run_folder.lock import LockState, lock_state
from omnilab.runner.run_folder.names import DONE, FAILED, INTERRUPTED, KILLED, RUNNING, SILENT, UNREADABLE
from omnilab.runner.run_folder.progress import RunProgress, read_progress
from omnilab.runner.sweeps.job_log import PLANNED
from omnilab.runner.sweeps.state import Job, LoadedSweep

BAD = (FAILED, KILLED, INTERRUPTED, UNREADABLE)
ORDER = (RUNNING, SILENT, *BAD, DONE, PLANNED)  # what is to be seen first


@dataclass(frozen=True)
class Snapshot:
    """A sweep as it was read, and what its running jobs say of themselves."""

    sweep: LoadedSweep
    progress: dict[int, RunProgress] = field(default_factory=dict)  # of running jobs, by number
    leader: LockState | None = None  # the process that leads the sweep
    now_s: float = field(default_factory=time.time)

    @cached_property
    def total(self) -> int:
        return sum(self.sweep.counts.values())

    @property
    def ended(self) -> int:
        """Jobs that are done or have failed; those that were cut off are to be run again."""
        return sum(self.sweep.counts.get(state, 0) for state in (DONE, FAILED))

    @property
    def goes_on(self) -> bool:
        """Whether a process leads the sweep, or may; or jobs run without one."""
        return bool(self.leader and self.leader.state in (RUNNING, SILENT)) or bool(self.sweep.counts.get(RUNNING))

    @cached_property
    def fraction(self) -> float:
        """Of the sweep, from 0 to 1, by jobs; one that runs counts by the time that its like took."""
        begun = sum(1.0 - left / self._mean_s for left in self._lefts_s) if self._mean_s else 0.0
        return min(1.0, (self.ended + begun) / self.total) if self.total else 0.0

    @cached_property
    def left_s(self) -> float | None:
        """Time to the end, if as many jobs run at once as now and take as long as those that are done. None: not known."""
        running, planned = self._lefts_s, self.sweep.counts.get(PLANNED, 0)
        if not self.goes_on or not self._mean_s or not (running or planned):
            return None
        work_s = sum(running) + self._mean_s * planned
        return max([0.0, work_s / max(1, len(running)), *running])

    @cached_property
    def _mean_s(self) -> float:
        """How long a job takes that is done; 0 where none says so."""
        took = [s for job in self.sweep.jobs if job.state == DONE and (s := self.seconds(job))]
        return sum(took) / len(took) if took else 0.0

    @cached_property
    def _lefts_s(self) -> list[float]:
        """Of the running jobs: the time that is left by what others took, and by their stage."""
        return [self._job_left_s(job) for job in self.sweep.jobs if job.state == RUNNING]

    def _job_left_s(self, job: Job) -> float:
        progress, mean_s = self.progress.get(job.number), self._mean_s
        stage_s = min((progress and progress.left_s) or 0.0, mean_s)
        return max(0.0, mean_s - (self.seconds(job) or 0.0), stage_s)

    def seconds(self, job: Job) -> float | None:
        """How long a job took, or has taken; never less than 0, whatever the clock of its host. None: not known."""
        if job.state == KILLED:  # nobody wrote down when
            return None
        began = _stamp_s(job.started)
        end = self.now_s if job.state in (RUNNING, SILENT) else _stamp_s(job.ended)
        return None if began is None or end is None else max(0.0, end - began)

    def elsewhere(self, job: Job) -> str:
        """The host of a job, where it is not this one; "" else."""
        return job.host if job.host and job.host != process.host() else ""

    def of(self, *states: str) -> list[Job]:
        """The jobs in these states, in the order of the states, and those that began last first."""
        rank = {state: i for i, state in enumerate(states)}
        found = [job for job in self.sweep.jobs if job.state in rank]
        return sorted(found, key=lambda job: (rank[job.state], -job.number if job.state in BAD else job.number))

    @cached_property
    def parameters(self) -> dict[str, str]:
        """What differs between the jobs: its names in full, and as short as they can be."""
        swept = list(self.sweep.plan.parameters) if self.sweep.plan else []
        return _short_names(swept or _differing(self.sweep.jobs))

    def differing(self, job: Job) -> str:
        """A job's values of what differs: "angles=45, step_m=0.2"."""
        shown = self.parameters
        return ", ".join(f"{shown[name]}={value}" for name, value in job.settings.items() if name in shown)


def snapshot(sweep: LoadedSweep) -> Snapshot:
    """Ask the running jobs how far they are."""
    found = {job.number: read_progress(job.folder) for job in sweep.jobs if job.state == RUNNING}
    progress = {number: own for number, own in found.items() if own is not None}
    return Snapshot(sweep, progress, lock_state(sweep.folder))


def _differing(jobs: Iterable[Job]) -> list[str]:
    """The settings that not all jobs have the same."""
    values: dict[str, set[str | None]] = {}
    for job in jobs:
        for name, value in job.settings.items():
            values.setdefault(name, set()).add(value)
    return [name for name, found in values.items() if len(found) > 1]


def _short_names(names: Iterable[str]) -> dict[str, str]:
    """The last words of names, but of those that would be the same."""
    last = {name: name.rpartition(".")[2] for name in names}
    taken = Counter(last.values())
    return {name: short if taken[short] == 1 else name for name, short in last.items()}


def _stamp_s(iso: str | None) -> float | None:
    """Seconds since 1970; None for what is no time."""
    try:
        return datetime.fromisoformat(iso).timestamp() if iso else None
    except (ValueError, OverflowError, OSError):
        return None
