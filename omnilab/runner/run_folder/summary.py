"""The table over the jobs of a sweep."""

from __future__ import annotations

from pathlib import Path

from omnilab.errors import DataError
from omnilab.runner.run_folder.names import UNREADABLE
from omnilab.runner.run_folder.reading import LoadedRun, find_runs
from omnilab.runner.run_folder.tables import number, write_csv


def write_summary(folder: Path) -> tuple[list[str], list[list[str]]]:
    """`summary.csv` of a sweep: one row a job, its overrides and metrics as columns. Returns header and rows."""
    runs = sorted(find_runs(folder), key=lambda run: int(run.folder.name) if run.folder.name.isdigit() else 0)
    jobs = [(run.folder.name, *_job(run)) for run in runs]
    keys = list(dict.fromkeys(key for _, overrides, _, _ in jobs for key in overrides))
    metrics = list(dict.fromkeys(name for *_, found in jobs for name in found))
    rows = [
        [name, *(overrides.get(key, "") for key in keys), state]
        + [number(found[metric]) if metric in found else "" for metric in metrics]
        for name, overrides, state, found in jobs
    ]
    header = ["job", *keys, "status", *metrics]
    write_csv(folder / "summary.csv", header, rows)
    return header, rows


def _job(run: LoadedRun) -> tuple[dict[str, str], str, dict[str, float]]:
    """Overrides, state and metrics of a sweep's job; one that is damaged hides no other."""
    try:
        return dict(o.split("=", 1) for o in run.manifest["overrides"] if "=" in o), run.state, run.metrics
    except DataError:
        return {}, UNREADABLE, {}
