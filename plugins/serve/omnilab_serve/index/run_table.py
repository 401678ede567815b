"""The records of all runs in memory, searched and sorted."""

from __future__ import annotations

import threading
from bisect import bisect_left, insort
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from omnilab.client import RunPage, RunRecord
from omnilab_serve.index.query import parse
from omnilab_serve.index.values import in_order

NEWEST_FIRST = "-started"
MOST_KEPT = 16  # answers


@dataclass(frozen=True)
class RunNames:
    """What runs have values of, by name."""

    metrics: Sequence[str] = ()
    slots: Sequence[str] = ()  # of components
    settings: Sequence[str] = ()


class RunTable:
    """Records by path. They are never changed but replaced, so that a reader never waits for a writer."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._runs: dict[str, RunRecord] = {}
        self._by_age: list[RunRecord] = []  # in the order of `_age`
        self._newest_first: tuple[RunRecord, ...] | None = ()
        self._found: dict[tuple[str, str], Sequence[RunRecord]] = {}
        self._names: tuple[object, RunNames] = (None, RunNames())  # and the runs whose they are

    def put(self, records: Iterable[RunRecord], gone: Iterable[str] = ()) -> None:
        """Add or replace records, and take others out."""
        with self._lock:
            for path in gone:
                self._remove(path)
            for record in records:
                self._remove(record.path)
                self._runs[record.path] = record
                insort(self._by_age, record, key=_age)
            self._newest_first, self._found = None, {}

    def _remove(self, path: str) -> None:
        if (record := self._runs.pop(path, None)) is not None:
            del self._by_age[bisect_left(self._by_age, _age(record), key=_age)]

    def run(self, path: str) -> RunRecord | None:
        return self._runs.get(path)

    def runs(self) -> tuple[RunRecord, ...]:
        """All of them, the newest first, and last those of which it is not known when they began."""
        with self._lock:
            if self._newest_first is None:
                self._newest_first = tuple(reversed(self._by_age))
            return self._newest_first

    def names(self) -> RunNames:
        """Of all runs: metrics in the order of their studies, and slots and settings by name."""
        runs = self.runs()
        if self._names[0] is not runs:
            metrics = dict.fromkeys(name for run in runs for name in run.metrics)
            slots = {slot for run in runs for slot in run.components if not slot.startswith("sinks.")}
            settings = {name for run in runs for name in run.settings}
            self._names = runs, RunNames(list(metrics), sorted(slots), sorted(settings - slots))
        return self._names[1]

    def search(self, query: str, sort: str, offset: int, limit: int) -> RunPage:
        """Some of those that match; ConfigError for a query that cannot be read."""
        found = self._matching(query, sort)
        return RunPage(len(found), found[offset : offset + limit])

    def _matching(self, query: str, sort: str) -> Sequence[RunRecord]:
        """All that match, in order; the last answers are kept until something changes."""
        wanted, runs, kept = parse(query), self.runs(), self._found
        found = kept.get((query, sort))
        if found is None:
            found = [run for run in runs if wanted.matches(run)] if wanted.terms else runs
            found = found if sort == NEWEST_FIRST else in_order(found, sort)
            if len(kept) >= MOST_KEPT:
                kept.clear()
            if runs is self._newest_first:
                kept[query, sort] = found
        return found


def _age(record: RunRecord) -> tuple[str, str]:
    return record.started or "", record.path
