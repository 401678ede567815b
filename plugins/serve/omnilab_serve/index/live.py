"""Runs that go on and sweeps, read again when their files change, and now and then for what no file says: that one was killed."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from omnilab.client import RunRecord, SweepRecord
from omnilab.errors import DataError
from omnilab.runner.compare.configurations import SectionReader
from omnilab.runner.run_folder import RUNNING, SILENT, UNREADABLE, LoadedRun
from omnilab.runner.run_folder.names import PROGRESS, STATUS
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.plan_file import PLAN
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.snapshot import snapshot
from omnilab_serve.index.compact import compact
from omnilab_serve.index.folders import stamp
from omnilab_serve.index.records import encodable, record_at, stage_progress
from omnilab_serve.index.sweep_records import sweep_record

ALIVE = (RUNNING, SILENT)
REST = 10  # sweeps that do not go on are looked at every so many times


class LiveRuns:
    """The runs that go on, or may."""

    def __init__(self, root: Path) -> None:
        self._root, self._sections = root, SectionReader()
        self._runs: dict[str, tuple[object, RunRecord]] = {}

    def read(self, path: str) -> RunRecord:
        """The run of a path, which is watched from now on if it goes on."""
        seen = self._stamp(path)
        record = compact(record_at(path, self._root, self._sections))
        self._keep(path, seen, record)
        return record

    def forget(self, path: str) -> None:
        self._runs.pop(path, None)

    def is_watched(self, path: str) -> bool:
        """Whether the run of a path goes on, or may."""
        return path in self._runs

    def poll(self, thorough: bool) -> list[RunRecord]:
        """Those that have changed. `thorough`: ask also for the processes of those whose files have not."""
        changed = []
        for path, (before, record) in list(self._runs.items()):
            seen = self._stamp(path)
            if thorough or seen != before:
                now = self._after(record)
                self._keep(path, seen, now)
                if now != record:
                    changed.append(now)
        return changed

    def _after(self, record: RunRecord) -> RunRecord:
        """A run as it is now: of one that still runs, how far."""
        run = LoadedRun(self._root / record.path)
        try:
            still = run.state == record.state == RUNNING
        except (DataError, OSError):
            still = False
        if not still:
            return compact(record_at(record.path, self._root, self._sections))
        progress = run.progress
        return replace(record, progress=stage_progress(progress), seconds=progress.run_s if progress else None)

    def _keep(self, path: str, seen: object, record: RunRecord) -> None:
        if record.state in ALIVE:
            self._runs[path] = seen, record
        else:
            self.forget(path)

    def _stamp(self, path: str) -> object:
        return stamp(self._root / path / STATUS), stamp(self._root / path / PROGRESS)


class SweepWatch:
    """All sweeps: those that go on are read again as their jobs change."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._readers: dict[str, SweepReader] = {}  # of those that go on
        self._stamps: dict[str, object] = {}
        self._turn = 0
        self.records: dict[str, SweepRecord] = {}  # replaced as a whole, for other threads read it
        self.has_moved = False  # whether one had come or gone at the last look

    def poll(self, paths: Collection[str], touched: Collection[str], thorough: bool) -> list[str]:
        """The sweeps that have come, changed or gone, of those there are; `touched`: those whose runs have changed."""
        self._turn += 1
        records = {path: self._current(path, path in touched, thorough) for path in paths}
        changed = [path for path, record in records.items() if record != self.records.get(path)]
        gone = self.records.keys() - records.keys()
        for path in gone:
            self._readers.pop(path, None)
            self._stamps.pop(path, None)
        self.has_moved = records.keys() != self.records.keys()
        self.records = records
        return [*changed, *gone]

    def _current(self, path: str, touched: bool, thorough: bool) -> SweepRecord:
        before, goes_on = self.records.get(path), path in self._readers
        if before is not None and not (touched or goes_on or self._turn % REST == 0):
            return before
        seen = self._stamp(path)
        if before is not None and not touched and seen == self._stamps.get(path) and not (thorough and goes_on):
            return before
        self._stamps[path] = seen
        return self._read(path)

    def _read(self, path: str) -> SweepRecord:
        """A sweep as it stands; one that is damaged hides no other."""
        reader = self._readers.get(path) or SweepReader(self._root / path)
        try:
            seen = snapshot(reader.load())
        except (DataError, OSError) as error:
            self._readers.pop(path, None)
            return SweepRecord(path, UNREADABLE, error=encodable(str(error)))
        if seen.goes_on:
            self._readers[path] = reader
        else:
            self._readers.pop(path, None)
        return sweep_record(seen, path)

    def _stamp(self, path: str) -> object:
        return stamp(self._root / path / JOBS), stamp(self._root / path / PLAN)
