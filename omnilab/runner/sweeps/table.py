"""`summary.csv`: the table over the jobs of a sweep, written anew whenever one has ended."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from omnilab.runner.run_folder.names import SUMMARY
from omnilab.runner.run_folder.tables import number, write_csv
from omnilab.runner.sweeps.job_log import PLANNED, JobLog
from omnilab.runner.sweeps.reader import reader_of
from omnilab.runner.sweeps.state import Job


def table(jobs: Iterable[Job]) -> tuple[list[str], list[list[str]]]:
    """Header and rows: one row for each job that was begun, with its overrides and metrics as columns."""
    begun = [job for job in jobs if job.state != PLANNED]
    keys = list(dict.fromkeys(key for job in begun for key in job.settings))
    metrics = list(dict.fromkeys(metric for job in begun for metric in job.metrics))
    rows = [
        [job.folder.name, *(job.settings.get(key, "") for key in keys), job.state]
        + [number(job.metrics[metric]) if metric in job.metrics else "" for metric in metrics]
        for job in begun
    ]
    return ["job", *keys, "status", *metrics], rows


def write_table(log: JobLog, folder: Path) -> None:
    """Write the table as the events tell, under the log's lock, so that no older one takes its place. OSError."""
    with log.locked():  # of which there may be none on a full disk
        header, rows = table(reader_of(folder).reported())
        write_csv(folder / SUMMARY, header, rows)
