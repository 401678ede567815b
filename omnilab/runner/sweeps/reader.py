"""Reads a sweep over and over while it goes on: only what has changed since."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

from omnilab.errors import DataError
from omnilab.file_kinds import opened
from omnilab.runner.sweeps.job_log import JOBS, LARGEST, Event, events_in, log_of
from omnilab.runner.sweeps.plan_file import PLAN, SweepPlan, read_plan
from omnilab.runner.sweeps.state import Job, LoadedSweep, as_they_stand, load_sweep, tell


@cache
def reader_of(folder: Path) -> SweepReader:
    """The reader of a sweep in which this process takes part."""
    return SweepReader(folder, log_of(folder).unwritten)


class SweepReader:
    """As `load_sweep`, of one folder: of `jobs.jsonl` it reads what was appended since the last time."""

    def __init__(self, folder: Path, unwritten: Iterable[Event] = ()) -> None:
        """`unwritten`: events beside those on the disk, looked at each time."""
        self._folder, self._unwritten = folder.resolve(), unwritten
        self._plan: tuple[object, SweepPlan | None] = (None, None)  # and when its file was written
        self._begin()

    def _begin(self) -> None:
        self._jobs: dict[int, Job] = {}
        self._read = self._damaged = 0  # bytes, lines

    def reported(self) -> list[Job]:
        """The jobs as their events tell of them, whatever has become of those that had not ended."""
        self._go_on()
        jobs = dict(self._jobs)
        tell(jobs, self._unwritten, self._folder)
        return [jobs[number] for number in sorted(jobs)]

    def load(self) -> LoadedSweep:
        """The sweep as it stands now; DataError if there is none."""
        if not (self._folder / JOBS).is_file():
            return load_sweep(self._folder, self._unwritten)
        stand = as_they_stand(self.reported(), self._folder)
        return LoadedSweep(self._folder, self._current_plan(), stand, self._damaged)

    def _go_on(self) -> None:
        """Read the whole lines that were appended; all of them, of a file that is another one now."""
        try:
            with opened(self._folder / JOBS, LARGEST) as stream:
                size = stream.seek(0, 2)
                if size < self._read:
                    self._begin()
                stream.seek(self._read)
                text = stream.read(size - self._read)
        except OSError as error:
            raise DataError(f"{self._folder / JOBS} cannot be read ({error.strerror}); mend or move it away") from error
        whole = text[: text.rfind(b"\n") + 1]
        events, damaged = events_in(whole)
        tell(self._jobs, events, self._folder)
        self._read, self._damaged = self._read + len(whole), self._damaged + damaged

    def _current_plan(self) -> SweepPlan | None:
        try:
            found = (self._folder / PLAN).stat()
            state = found.st_mtime_ns, found.st_size, found.st_ino
        except OSError:
            return read_plan(self._folder)
        if state != self._plan[0]:
            self._plan = state, read_plan(self._folder)
        return self._plan[1]
