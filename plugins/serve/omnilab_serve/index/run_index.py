"""The runs and sweeps below the logs, kept up to date."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omnilab.client import RunPage, RunRecord, SweepRecord
from omnilab.runner.run_folder import find_runs
from omnilab_serve.events import Events
from omnilab_serve.index.records import run_record


class RunIndex:
    """What is known of all runs and sweeps; publishes what changes."""

    def __init__(self, logs: Path, events: Events) -> None:
        self.logs, self._events = logs, events

    def start(self) -> None:
        """Look at the folders, and from now on at what changes in them."""

    def stop(self) -> None:
        """Look no more."""

    def runs(self) -> Sequence[RunRecord]:
        """All runs, the newest first."""
        return [run_record(run, self.logs) for run in reversed(find_runs(self.logs))]

    def run(self, path: str) -> RunRecord | None:
        """The run of a path; None if there is none."""
        return next((run for run in self.runs() if run.path == path), None)

    def search(self, query: str = "", sort: str = "-started", offset: int = 0, limit: int = 100) -> RunPage:
        """Some of the runs that match a query, in an order."""
        del query, sort
        runs = self.runs()
        return RunPage(len(runs), runs[offset : offset + limit])

    def sweeps(self) -> Sequence[SweepRecord]:
        """All sweeps, the newest first, without their jobs."""
        return []
