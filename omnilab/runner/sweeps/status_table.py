"""A sweep as a table of its jobs, a line of counts, a bar, and as data."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from omnilab.errors import visible
from omnilab.runner.run_folder.names import DONE, FAILED, INTERRUPTED, KILLED, RUNNING, SILENT
from omnilab.runner.sweeps.job_log import PLANNED
from omnilab.runner.sweeps.snapshot import BAD, Snapshot
from omnilab.runner.sweeps.state import TO_RESUME, Job
from omnilab.runner.terminal import headline, short

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

COLORS = {RUNNING: "cyan", DONE: "green", SILENT: "yellow", PLANNED: "dim"} | dict.fromkeys(BAD, "red")
ORDER = (RUNNING, SILENT, *BAD, DONE, PLANNED)  # of counts
HEADER = ("job", "settings", "state", "time", "progress")
RIGHT, GAP = ("job", "time"), 2  # columns of numbers; characters between columns
GONE = "its process is gone, without a word"
AROUND = 5  # lines above and below the rows of a table on a terminal


def duration(seconds: float | None) -> str:
    """In words, with two digits: 0.4 s, 12 s, 5 min, 1.5 h, 3 days; "" where it is not known."""
    if seconds is None or not math.isfinite(seconds):
        return ""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.95 * size:
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 9.95 or unit == "min" else f"{value:.1f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 9.95 else f"{seconds:.1f} s"


def overall(seen: Snapshot) -> str:
    """As "3 of 24 jobs done, 2 failed, about 5 min left"."""
    counts = seen.sweep.counts
    words = [f"{counts.get(DONE, 0)} of {seen.total} jobs done"]
    words += [f"{counts[state]} {state}" for state in (*BAD, SILENT) if counts.get(state)]
    if seen.left_s is not None:
        words.append(f"about {duration(seen.left_s)} left" if seen.left_s >= 1 else "nearly done")
    return ", ".join(words)


def counted(seen: Snapshot) -> str:
    """How many jobs there are of each state."""
    counts = seen.sweep.counts
    return ", ".join(f"{counts[state]} {state}" for state in ORDER if counts.get(state)) or "no job yet"


def what_happened(seen: Snapshot, job: Job) -> str:
    """A job's change, in a line: "job 3 (angles=45) done in 12 s: nearest_rate 0.88"."""
    own = seen.differing(job)
    words = f"job {job.number}{f' ({own})' if own else ''} {job.state}{_on(seen, job)}"
    took, more = duration(seen.seconds(job)), headline(job.metrics) if job.state == DONE else job.error
    if took and job.state != RUNNING:
        words += f" {'in' if job.state == DONE else 'after'} {took}"
    return f"{words}: {more}" if more else words


def _on(seen: Snapshot, job: Job) -> str:
    where = seen.elsewhere(job)
    return f" on {where}" if where else ""


def state(seen: Snapshot) -> str:
    """Of the sweep as a whole: running, silent, done, failed, or interrupted (jobs are still to be done)."""
    counts = seen.sweep.counts
    if seen.goes_on:
        leads = seen.leader is not None and seen.leader.state == SILENT and not counts.get(RUNNING)
        return SILENT if leads else RUNNING
    if any(counts.get(state) for state in TO_RESUME):
        return INTERRUPTED
    return SILENT if counts.get(SILENT) else FAILED if counts.get(FAILED) else DONE


def advice(seen: Snapshot) -> list[str]:
    """What there is to do, in sentences: about silent jobs, and about a sweep that does not go on by itself."""
    found = []
    for job in seen.of(SILENT)[:1]:
        folder = shlex.quote(str(short(job.folder)))
        more = f" (and {n - 1} more)" if (n := len(seen.of(SILENT))) > 1 else ""
        found.append(
            f"job {job.number}{more} is silent: whether its process lives{_on(seen, job)} cannot be told from here;"
            f" look there, and if it has ended: omnilab repair --ended {folder}"
        )
    if seen.leader and seen.leader.state == SILENT:
        found.append(f"{seen.leader.sentence(short(seen.sweep.folder))}; look there")
    left = sum(seen.sweep.counts.get(state, 0) for state in TO_RESUME)
    sweep = shlex.quote(str(short(seen.sweep.folder)))
    if left and not seen.goes_on:
        found.append(f"{left} jobs are still to be done, and no process goes on: omnilab sweep resume {sweep}")
    elif not seen.goes_on and seen.sweep.counts.get(FAILED):
        found.append(f"to run what failed once more: omnilab sweep resume {sweep} --retry-failed")
    if seen.sweep.damaged_lines:
        found.append(f"{seen.sweep.damaged_lines} lines of jobs.jsonl are damaged, and left out here")
    return found


# ------------------------------------------------------------------------------------------------------- a terminal
def board(seen: Snapshot, console: Console, most: int | None = None) -> RenderableType:
    """The jobs that run, then those that ended badly, as many as there is room for; the others counted; a bar.

    `most`: rows, where it is not the height of the terminal that bounds them.
    """
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    rows = _chosen(seen, max(1, console.height - AROUND) if most is None else most)
    parts: list[RenderableType] = [_job_table(seen, rows, console.width)] if rows else []
    if len(rows) < seen.total:
        parts.append(Text(_others(seen, rows), style="dim", overflow="ellipsis", no_wrap=True))
    words = Text(overall(seen), overflow="ellipsis", no_wrap=True)
    bar = ProgressBar(total=1.0, completed=seen.fraction, width=max(10, min(40, console.width - words.cell_len - 2)))
    grid = Table.grid(padding=(0, 2))
    grid.add_row(bar, words)
    return Group(*parts, grid if console.is_terminal and console.width >= words.cell_len + 12 else words)


def _chosen(seen: Snapshot, most: int) -> list[Job]:
    """Running jobs, and of the others the last that ended badly, for which a third of the rows is kept."""
    running, bad = seen.of(RUNNING, SILENT), seen.of(*BAD)
    kept = min(len(bad), max(most // 3, most - len(running)))
    return running[: most - kept] + bad[:kept]


def _others(seen: Snapshot, rows: Iterable[Job]) -> str:
    """Those that are not in the table, by states."""
    left = dict(seen.sweep.counts)
    shown = [job.state for job in rows]
    for state in shown:
        left[state] -= 1
    more = "and " if shown else ""
    return more + ", ".join(
        f"{left[state]} {'more ' if state in shown else ''}{state}" for state in ORDER if left.get(state)
    )


def _job_table(seen: Snapshot, rows: Iterable[Job], width: int) -> RenderableType:
    """A line a job: columns as wide as what is in them, of which the last two share what is left."""
    from rich.table import Table
    from rich.text import Text

    cells = [[Text(visible(cell)) for cell in _cells(seen, job)] for job in rows]
    for line, job in zip(cells, rows, strict=True):
        line[2].stylize(COLORS.get(job.state, ""))
        line[4].stylize("red" if job.state in BAD else "")
    widths = [max(len(name), *(line[i].cell_len for line in cells)) for i, name in enumerate(HEADER)]
    room = max(2, width - sum(widths[i] for i in (0, 2, 3)) - GAP * (len(HEADER) - 1))
    widths[1] = min(widths[1], max(room - widths[4], room * 2 // 5))
    widths[4] = min(widths[4], room - widths[1])
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), header_style="bold")
    for name, own in zip(HEADER, widths, strict=True):
        table.add_column(
            name, width=max(1, own), no_wrap=True, overflow="ellipsis", justify="right" if name in RIGHT else "left"
        )
    for line in cells:
        table.add_row(*line)
    return table


def _cells(seen: Snapshot, job: Job) -> tuple[str, ...]:
    return str(job.number), seen.differing(job), job.state, duration(seen.seconds(job)), _doing(seen, job)


def _doing(seen: Snapshot, job: Job) -> str:
    """How far a job is, and on which host if not on this one; or what was wrong with it."""
    if job.state in BAD:
        return job.error or (GONE if job.state == KILLED else "")
    progress = seen.progress.get(job.number)
    words = [progress.words] if progress and progress.words else []
    if progress and progress.left_s is not None and progress.total > progress.done:
        words.append(f"{duration(progress.left_s)} left")
    if where := seen.elsewhere(job):
        words.append(f"on {where}")
    return ", ".join(words)


# ------------------------------------------------------------------------------------------------------------- data
def data(seen: Snapshot) -> dict[str, Any]:
    """The same for other programs, as JSON can hold it: a metric without a value is null."""
    sweep, plan = seen.sweep, seen.sweep.plan
    return {
        "folder": str(sweep.folder),
        "command": plan and plan.command,
        "launcher": plan and plan.launcher,
        "sweeper": plan and plan.sweeper,
        "began": plan and plan.time,
        "state": state(seen),
        "total": seen.total,
        "counts": sweep.counts,
        "left_s": seen.left_s,
        "advice": advice(seen),
        "jobs": [_job_data(seen, job) for job in sweep.jobs],
    }


def _job_data(seen: Snapshot, job: Job) -> dict[str, Any]:
    progress = seen.progress.get(job.number)
    return {
        "number": job.number,
        "overrides": list(job.overrides),
        "state": job.state,
        "folder": str(job.folder),
        "host": job.host,
        "pid": job.pid,
        "started": job.started,
        "ended": job.ended,
        "seconds": seen.seconds(job),
        "error": job.error,
        "metrics": {name: value if math.isfinite(value) else None for name, value in job.metrics.items()},
        "progress": progress
        and {"stage": progress.stage, "done": progress.done, "total": progress.total, "stage_left_s": progress.left_s},
    }
