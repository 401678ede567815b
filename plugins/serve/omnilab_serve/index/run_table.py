"""The records of all runs in memory, searched and sorted."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from omnilab.client import RunPage, RunRecord
from omnilab_serve.index.query import parse
from omnilab_serve.index.values import in_order

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
        self._newest_first: tuple[RunRecord, ...] | None = ()
        self._found: dict[tuple[str, str], list[RunRecord]] = {}
        self._names: tuple[object, RunNames] = (None, RunNames())  # and the runs whose they are

    def put(self, records: Iterable[RunRecord], gone: Iterable[str] = ()) -> None:
        """Add or replace records, and take others out."""
        with self._lock:
            for path in gone:
                self._runs.pop(path, None)
            for record in records:
                self._runs[record.path] = record
            self._newest_first, self._found = None, {}

    def run(self, path: str) -> RunRecord | None:
        return self._runs.get(path)

    def runs(self) -> tuple[RunRecord, ...]:
        """All of them, the newest first."""
        with self._lock:
            if self._newest_first is None:
                by_path = sorted(self._runs.values(), key=lambda record: record.path, reverse=True)
                self._newest_first = tuple(in_order(by_path, "-started"))
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
            found = in_order(filter(wanted.matches, runs), sort)
            if len(kept) >= MOST_KEPT:
                kept.clear()
            if runs is self._newest_first:
                kept[query, sort] = found
        return found
