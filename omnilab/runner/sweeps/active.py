"""The sweep that this process leads: its folder and lock, and what is known of its jobs."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

from omnilab.errors import DataError
from omnilab.runner.run_folder.lock import LOCK, RunLock
from omnilab.runner.run_folder.names import DONE, FAILED, RUNNING, SILENT
from omnilab.runner.sweeps.job_log import PLANNED, RESUMED, log_of
from omnilab.runner.sweeps.plan_file import PLAN, SweepPlan
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.state import Job, LoadedSweep


class ActiveSweep:
    """What a launcher asks: which number a job has, how it stands, and whether it is to be run."""

    now: ClassVar[ActiveSweep | None] = None

    def __init__(
        self, folder: Path, lock: RunLock, launcher: Any, say: Callable[[str], object], retry_failed: bool | None
    ) -> None:
        """`retry_failed` is None of a sweep that begins, else whether jobs that failed are run again too."""
        self.folder, self.lock, self.launcher, self.say = folder, lock, launcher, say
        self.retry_failed = retry_failed
        self.log = log_of(folder)
        self._reader = SweepReader(folder, self.log.unwritten)
        self._before = [] if retry_failed is None else self.load().jobs
        self._numbered = set[int]()  # jobs that were handed out

    @property
    def resumed(self) -> bool:
        return self.retry_failed is not None

    def begin(self, plan: SweepPlan) -> None:
        """Write down what is to be done, before the first job. DataError if the disk does not take it."""
        try:
            plan.write(self.folder)
        except OSError as error:
            raise DataError(f"{error.filename} cannot be written ({error.strerror}); make room there") from error
        if self.resumed:
            self.log.append({"event": RESUMED, "command": plan.command})

    def load(self) -> LoadedSweep:
        """How all jobs stand."""
        return self._reader.load()

    def plan(self, job_overrides: Sequence[Sequence[str]]) -> dict[int, list[str]]:
        """The jobs' numbers, in order: those that they had before, or the next ones."""
        free: dict[tuple[str, ...], list[int]] = {}
        for job in self._before:
            if job.number not in self._numbered:
                free.setdefault(job.overrides, []).append(job.number)
        following = max([-1, *self._numbered, *(job.number for job in self._before)]) + 1
        jobs: dict[int, list[str]] = {}
        new: list[dict[str, Any]] = []
        for overrides in map(list, job_overrides):
            own = tuple(own_overrides(overrides))
            if known := free.get(own):
                jobs[known.pop(0)] = overrides
                continue
            jobs[following] = overrides
            new.append({"event": PLANNED, "job": following, "overrides": own})
            following += 1
        self._numbered |= jobs.keys()
        if new:
            self.log.append(*new)
        return jobs

    def to_run(self, job: Job, identity: Callable[[], str | None]) -> bool:
        """Whether a job is to be launched: not if it is done, with the same identity, if it goes on, or has failed."""
        if job.state == SILENT:
            self.say(
                f"job {job.number} may still be running on {job.host or 'another host'}, and is left to it; look there, and if"
                f" it has ended: omnilab repair --ended {shlex.quote(str(job.folder))}, then resume the sweep again"
            )
        if job.state in (RUNNING, SILENT):
            return False
        if job.state == FAILED:
            return bool(self.retry_failed)
        if job.state != DONE:
            return True
        if job.identity != identity():
            self.say(f"job {job.number} was done with other versions, settings or files, and is run again")
            return True
        return False

    def release(self) -> None:
        """Let other sweeps into the folder, which say that it is taken; without a trace where no job was planned."""
        if not self.resumed and {path.name for path in self.folder.glob("*")} <= {LOCK, PLAN}:
            for name in (PLAN, LOCK):
                with suppress(OSError):  # then it stays, and says that nobody holds it
                    (self.folder / name).unlink(missing_ok=True)
        self.lock.release()


def own_overrides(overrides: Sequence[str]) -> list[str]:
    """Those of a job's overrides that are its own, not Hydra's."""
    return [override for override in overrides if not override.lstrip("+~").startswith(("hydra.", "hydra/"))]
