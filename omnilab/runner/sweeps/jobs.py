"""A job of a sweep in the process that runs it: it begins only where no other has, and its life is written down."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from omnilab.errors import DataError
from omnilab.runner.run_folder.lock import RUN, Holder, is_mine, lock_state
from omnilab.runner.run_folder.names import DONE, FAILED, RUNNING, SILENT, STATUS
from omnilab.runner.run_folder.reading import LoadedRun
from omnilab.runner.sweeps.job_log import Event, HeldLog, JobLog, log_of
from omnilab.runner.sweeps.state import ATTEMPTS
from omnilab.runner.sweeps.table import write_table

JOB = "OMNILAB_JOB"  # the environment variable by which a launcher tells a job its number


class JobLife:
    """One attempt at a job, from `begin` to `end`."""

    def __init__(self, number: int, folder: Path, sweep: Path, say: Callable[[str], object]) -> None:
        self.number, self.folder, self.sweep = number, folder, sweep
        self._log, self._say, self._warned, self._left = log_of(sweep), say, False, False

    def begin(self, identity: Callable[[], str]) -> bool:
        """Whether the job is to be run: not if another process runs it, or has, with the same identity.

        A folder that an attempt has left is moved aside, to `attempts/`, if its process is surely gone.
        """
        with self._log.locked() as log:
            state = self._state(identity)
            if state not in (RUNNING, SILENT, DONE):
                if state is not None:
                    self._move_aside()
                self._append(log, {"event": RUNNING, "process": asdict(Holder.here(RUN, flock=False))})
                return True
        self._left = True
        if state != DONE:
            self._say(f"job {self.number} is {state} in another process, and left to it")
        return False

    def end(self, overrides: list[str], error: BaseException | None) -> None:
        """Write down how it ended, and the table over all jobs; nothing of a job that was left to another process."""
        if self._left:
            return
        event = self._of_folder()
        if event is None:
            if self._is_of_another():
                self._say(f"job {self.number} was begun by another process meanwhile, and is left to it")
                return
            event = {"event": FAILED, "error": error and f"{type(error).__name__}: {error}"}
        self._append(self._log, {**event, "overrides": overrides})
        try:
            write_table(self._log, self.sweep)
        except (OSError, DataError) as why:
            self._warn(f"the table of the sweep is not up to date ({why})")

    def _is_of_another(self) -> bool:
        lock = lock_state(self.folder)
        return lock is not None and lock.state in (RUNNING, SILENT)

    def _state(self, identity: Callable[[], str]) -> str | None:
        """Of what is in the job's folder; None if there is nothing of a run. Done only with this identity."""
        if not (self.folder / STATUS).is_file():
            lock = lock_state(self.folder)
            return lock.state if lock else None
        run = LoadedRun(self.folder)
        try:
            state = run.state
            return FAILED if state == DONE and run.manifest.get("identity") != identity() else state
        except DataError:
            return FAILED

    def _move_aside(self) -> None:
        """Give the folder a name among the attempts."""
        below = self.folder.relative_to(self.sweep).as_posix().replace("/", "_")
        (self.sweep / ATTEMPTS).mkdir(exist_ok=True)
        taken = {path.name for path in (self.sweep / ATTEMPTS).iterdir()}
        free = next(name for k in range(1, len(taken) + 2) if (name := f"{below}.{k}") not in taken)
        self.folder.rename(self.sweep / ATTEMPTS / free)

    def _of_folder(self) -> Event | None:
        """How it ended, by its folder, with the results."""
        run = LoadedRun(self.folder)
        try:
            if not is_mine(self.folder) or run.status["status"] == RUNNING:
                return None
            metrics = {name: None if math.isnan(value) else value for name, value in run.metrics.items()}
            return {
                "event": str(run.status["status"]),
                "error": run.status.get("error"),
                "identity": run.manifest.get("identity"),
                "metrics": metrics,
            }
        except DataError:
            return None

    def _append(self, log: JobLog | HeldLog, event: Mapping[str, object]) -> None:
        below = self.folder.relative_to(self.sweep).as_posix()
        if why := log.append({"job": self.number, "folder": below, **event}):
            self._warn(f"{self._log.file} cannot be written ({why.strerror}); the jobs' own folders say how they ended")

    def _warn(self, sentence: str) -> None:
        if not self._warned:
            self._say(sentence)
        self._warned = True
