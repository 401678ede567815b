"""The jobs of a sweep as a grid: over the settings that are swept, coloured by state or by a metric."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from omnilab.client import JobRecord, SweepRecord
from omnilab_serve.comparing.charts import short, value_order
from omnilab_serve.words import duration, figure

SEED = "seed"  # what only says how far to trust a number is no axis: its jobs share a cell
LONGEST_AXIS = 60  # values
LEVELS = 10  # colours of a metric
MOST_WORDS = 150  # jobs whose cells have words in them


@dataclass(frozen=True)
class JobCell:
    """A job as a small box."""

    job: JobRecord
    tip: str
    words: str = ""
    level: int | None = None  # of its metric, from 0 to LEVELS - 1; None: no value


@dataclass(frozen=True)
class JobGrid:
    """Jobs in rows and columns; a single row without names where no one or two settings span them."""

    across: str  # the setting of the columns; "": none
    down: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Sequence[JobCell]]]]  # a row's value, and the jobs in each of its cells
    low: float | None = None  # of the metric
    high: float | None = None


def settings_of(job: JobRecord) -> dict[str, str]:
    """A job's overrides by name."""
    return dict(word.split("=", 1) for word in job.overrides if "=" in word)


def job_grid(sweep: SweepRecord, metric: str = "") -> JobGrid:
    """All jobs that are known, over the settings that are swept if these are one or two beside the seed."""
    values = [v for job in sweep.jobs if (v := job.metrics.get(metric)) is not None]
    low, high = (min(values), max(values)) if values else (None, None)
    cells = [_cell(job, sweep, metric, (low, high)) for job in sweep.jobs]
    found = {
        name: sorted({settings_of(job).get(name) for job in sweep.jobs} - {None}, key=value_order)
        for name in sweep.parameters
    }
    axes = [name for name, own in found.items() if len(own) > 1 and name != SEED] or [
        name for name, own in found.items() if len(own) > 1
    ]
    if len(axes) not in (1, 2) or any(len(found[name]) > LONGEST_AXIS for name in axes):
        return JobGrid("", "", [""], [("", [cells])], low, high)
    across, down = max(axes, key=lambda name: len(found[name])), ""
    if len(axes) == 2:
        down = next(name for name in axes if name != across)
    columns, rows = [str(v) for v in found[across]], [str(v) for v in found[down]] if down else [""]
    placed: dict[tuple[str, str], list[JobCell]] = {}
    for cell in cells:
        own = settings_of(cell.job)
        placed.setdefault((own.get(down, ""), own.get(across, "")), []).append(cell)
    return JobGrid(
        across, down, columns, [(row, [placed.get((row, column), []) for column in columns]) for row in rows], low, high
    )


def _cell(job: JobRecord, sweep: SweepRecord, metric: str, ends: tuple[float | None, float | None]) -> JobCell:
    own = settings_of(job)
    settings = ", ".join(f"{name}={short(own[name], 40)}" for name in sweep.parameters if name in own)
    value = job.metrics.get(metric)
    words = [f"job {job.number} ({settings})" if settings else f"job {job.number}", job.state]
    if job.seconds is not None:
        words.append(duration(job.seconds))
    if metric and job.metrics:
        words.append(f"{metric} {figure(value)}")
    if job.error:
        words.append(short(job.error, 200))
    shown = (figure(value) if value is not None else "") if metric else str(job.number)
    return JobCell(job, ", ".join(words), shown if len(sweep.jobs) <= MOST_WORDS else "", _level(value, ends))


def _level(value: float | None, ends: tuple[float | None, float | None]) -> int | None:
    low, high = ends
    if value is None or low is None or high is None:
        return None
    return min(LEVELS - 1, int(LEVELS * (value - low) / (high - low))) if high > low else LEVELS // 2


def sorted_jobs(jobs: Sequence[JobRecord], order: str) -> list[JobRecord]:
    """Jobs in an order: "" (those that ended badly first, then those that run), `job`, `seconds`, a setting or a metric; with - the largest first."""
    name, sign = order.removeprefix("-"), -1 if order.startswith("-") else 1
    if not name:
        return sorted(jobs, key=lambda job: (_urgency(job.state), job.number))
    if name == "job":
        return sorted(jobs, key=lambda job: sign * job.number)

    def by_number(job: JobRecord) -> tuple[bool, float, int]:
        value = job.seconds if name == "seconds" else job.metrics.get(name)
        return value is None, 0.0 if value is None else sign * value, job.number

    if name == "seconds" or any(name in job.metrics for job in jobs):
        return sorted(jobs, key=by_number)
    return sorted(jobs, key=lambda job: value_order(settings_of(job).get(name)), reverse=sign < 0)


def _urgency(state: str) -> int:
    order: Mapping[str, int] = {"failed": 0, "unreadable": 0, "killed": 1, "interrupted": 1, "silent": 1, "running": 2}
    return order.get(state, 4 if state == "planned" else 3)


def failures(jobs: Sequence[JobRecord]) -> list[tuple[str, list[JobRecord]]]:
    """What was wrong with jobs, each sentence with all its jobs; the most frequent first."""
    found: dict[str, list[JobRecord]] = {}
    for job in jobs:
        if job.error and job.state != "done":
            found.setdefault(job.error, []).append(job)
    return sorted(found.items(), key=lambda item: -len(item[1]))
