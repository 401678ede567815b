"""The table over the jobs of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from omnilab.errors import DataError
from omnilab.runner.run_folder.names import FAILED, UNREADABLE
from omnilab.runner.run_folder.reading import LoadedRun, find_runs
from omnilab.runner.run_folder.tables import number


def summarize(folder: Path, begun: Mapping[str, Sequence[str]] | None = None) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the table over a sweep: one row a job, its overrides and metrics as columns.

    `begun`: overrides of jobs by the names of their folders, of which some may not have been able to make those.
    """
    jobs = {run.folder.name: _job(run) for run in find_runs(folder)}
    for name, overrides in (begun or {}).items():
        jobs.setdefault(name, (_settings(overrides), FAILED, {}))
    ordered = sorted(jobs.items(), key=lambda job: int(job[0]) if job[0].isdigit() else 0)
    keys = list(dict.fromkeys(key for _, (overrides, _, _) in ordered for key in overrides))
    metrics = list(dict.fromkeys(metric for _, (_, _, found) in ordered for metric in found))
    rows = [
        [name, *(overrides.get(key, "") for key in keys), state]
        + [number(found[metric]) if metric in found else "" for metric in metrics]
        for name, (overrides, state, found) in ordered
    ]
    return ["job", *keys, "status", *metrics], rows


def _settings(overrides: Sequence[str]) -> dict[str, str]:
    return dict(override.split("=", 1) for override in overrides if "=" in override)


def _job(run: LoadedRun) -> tuple[dict[str, str], str, dict[str, float]]:
    """Overrides, state and metrics of a sweep's job; one that is damaged hides no other."""
    try:
        return _settings(run.manifest["overrides"]), run.state, run.metrics
    except DataError:
        return {}, UNREADABLE, {}
