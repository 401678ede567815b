"""The runs and sweeps below the logs, kept up to date."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from omnilab.client import RunPage, RunRecord, SweepRecord
from omnilab.runner.run_folder.names import STATUS, UNREADABLE
from omnilab_serve.events import RUNS, Events
from omnilab_serve.index.folders import RunFolders, Stamp, stamp
from omnilab_serve.index.live import ALIVE, LiveRuns, SweepWatch
from omnilab_serve.index.record_cache import RecordCache, cache_file
from omnilab_serve.index.run_table import NEWEST_FIRST, RunNames, RunTable

EVERY_S = 0.5  # how often what goes on is looked at
PROCESSOR_SHARE, DISK_SHARE, LONGEST_S = 200, 10, 10.0  # so many times its own time passes after a look, of either kind
FOLDERS, PROCESSES = 2, 4  # every so many looks folders, and the processes of runs, are looked at
ALL_S, ALL_SHARE = 300.0, 1000  # how often everything is looked at, also where no time of change says so
FIRST_S = 2.0  # how long a start waits for the first look, which goes on behind it
BATCH = 500  # runs of the first look, after which those there are are shown
MOST_TOPICS = 200  # of runs, in one look

log = logging.getLogger("omnilab")


class RunIndex:
    """What is known of all runs and sweeps, by one thread that reads their folders and publishes what changes.

    Topics: `runs` when one has come, gone, or changed its state; `run PATH` and `sweep PATH` also when it is further.
    """

    def __init__(self, logs: Path, events: Events) -> None:
        self.logs, self._root, self._events = logs, logs.resolve(), events
        self._table = RunTable()
        self._folders, self._live = RunFolders(self._root), LiveRuns(self._root)
        self._sweeps = SweepWatch(self._root)
        self._stamps: dict[str, Stamp] = {}  # of the status of runs that have ended
        self._turn, self._all_s, self._pause_s = 0, 0.0, EVERY_S
        self._stop, self._complete = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._watch, name="omnilab-index", daemon=True)

    def start(self) -> None:
        """Look at the folders, and from now on at what changes in them."""
        self._thread.start()
        self._complete.wait(FIRST_S)

    def stop(self) -> None:
        """Look no more."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def is_complete(self) -> bool:
        """Whether every run has been read since the start."""
        return self._complete.is_set()

    def runs(self) -> Sequence[RunRecord]:
        """All runs, the newest first."""
        return self._table.runs()

    def run(self, path: str) -> RunRecord | None:
        """The run of a path; None if there is none."""
        return self._table.run(path)

    def names(self) -> RunNames:
        """The metrics, component slots and settings that runs have."""
        return self._table.names()

    def search(self, query: str = "", sort: str = NEWEST_FIRST, offset: int = 0, limit: int = 100) -> RunPage:
        """Some of the runs that a query matches, in an order; ConfigError for a query that cannot be read."""
        return self._table.search(query, sort, offset, limit)

    def sweeps(self) -> Sequence[SweepRecord]:
        """All sweeps, the newest first, without their jobs."""
        found = self._sweeps.records.values()
        return sorted(found, key=lambda sweep: (sweep.started or "", sweep.path), reverse=True)

    def _watch(self) -> None:
        """The thread: what there is, then what changes."""
        cache = RecordCache(cache_file(self._root))
        try:
            self._begin(cache)
            while not self._stop.wait(self._pause_s):
                try:
                    self._poll(cache)
                except OSError as error:  # a disk that is away for a while
                    log.warning("the runs could not be looked at (%s); this is tried again", error)
                    self._pause_s = LONGEST_S
                except Exception:  # a bug about one run must not leave a table that is old without a word
                    log.exception("the runs could not be looked at; this is tried again")
                    self._pause_s = LONGEST_S
        finally:
            cache.close()
            self._complete.set()

    def _begin(self, cache: RecordCache) -> None:
        """Everything there is: from the cache what has not changed since, from the folders the rest."""
        start_s = time.monotonic()
        self._folders.poll()
        kept, gone = {}, []
        for path, seen, record in cache.load():
            if path not in self._folders.runs:
                gone.append(path)
            elif stamp(self._root / path / STATUS) == seen:
                kept[path], self._stamps[path] = record, seen
        cache.save([], gone)
        self._table.put(kept.values())
        missing = sorted(self._folders.runs - kept.keys(), reverse=True)
        for at in range(0, len(missing), BATCH):
            if not self._stop.is_set():
                self._read(missing[at : at + BATCH], cache)
                self._events.publish(RUNS)
        self._complete.set()
        self._sweeps.poll(self._folders.sweeps, (), thorough=True)
        self._events.publish(RUNS)
        self._plan(start_s)

    def _poll(self, cache: RecordCache) -> None:
        """What has changed since the last look, which is published."""
        self._turn += 1
        start_s, worked_s = time.monotonic(), time.thread_time()
        everything, thorough = start_s > self._all_s, self._turn % PROCESSES == 0
        moved = self._folders.poll(everything) if everything or self._turn % FOLDERS == 0 else set()
        if everything:
            moved |= self._overwritten()
        before = {path: self._table.run(path) for path in moved}
        live = self._live.poll(thorough)
        known = {record.path: self._table.run(record.path) for record in live}
        self._store(live, cache)
        read = self._read(moved, cache)
        self._publish(before | known, {record.path: record for record in (*live, *read)}, thorough)
        self._pause_s = max(EVERY_S, PROCESSOR_SHARE * (time.thread_time() - worked_s))
        self._pause_s = min(LONGEST_S, max(self._pause_s, DISK_SHARE * (time.monotonic() - start_s)))
        if everything:
            self._plan(start_s)

    def _plan(self, start_s: float) -> None:
        """When everything is looked at again, after a look that began then."""
        now_s = time.monotonic()
        self._all_s = now_s + max(ALL_S, ALL_SHARE * (now_s - start_s))

    def _overwritten(self) -> set[str]:
        """The runs that had ended, or could not be read, and have another status now."""
        return {
            path
            for path in self._folders.runs
            if not self._live.is_watched(path) and stamp(self._root / path / STATUS) != self._stamps.get(path)
        }

    def _read(self, paths: Iterable[str], cache: RecordCache) -> list[RunRecord]:
        """Bring the table up to date with what is, or is no longer, at these paths."""
        there, gone = [], []
        for path in paths:
            self._live.forget(path)
            self._stamps.pop(path, None)
            if path in self._folders.runs:
                there.append(self._live.read(path))
            else:
                gone.append(path)
        self._store(there, cache, gone)
        return there

    def _store(self, records: Sequence[RunRecord], cache: RecordCache, gone: Sequence[str] = ()) -> None:
        """Put records into the table, and those of runs that have ended into the cache."""
        if not records and not gone:
            return
        self._table.put(records, gone)
        ended = [record for record in records if record.state not in (*ALIVE, UNREADABLE)]
        for record in ended:
            self._stamps[record.path] = stamp(self._root / record.path / STATUS)
        cache.save([(record.path, self._stamps[record.path], record) for record in ended], gone)

    def _publish(self, before: dict[str, RunRecord | None], now: dict[str, RunRecord], thorough: bool) -> None:
        """Tell who watches: `before` are the records of which some are changed, or gone."""
        changed = {path for path, record in before.items() if now.get(path) != record}
        both = [*filter(None, before.values()), *now.values()]
        touched = {record.sweep for record in both if record.sweep and record.path in changed}
        sweeps = self._sweeps.poll(self._folders.sweeps, touched, thorough)
        topics = {f"sweep {path}" for path in (*sweeps, *touched)}
        topics |= {f"run {path}" for path in sorted(changed)[:MOST_TOPICS]}
        if any(_is_news(before[path], now.get(path)) for path in changed) or self._sweeps.has_moved:
            topics.add(RUNS)
        if topics:
            self._events.publish(*topics)


def _is_news(before: RunRecord | None, now: RunRecord | None) -> bool:
    """Whether a change is more than that a run is further."""
    return before is None or now is None or before.state != now.state or now.state not in ALIVE
