"""How a sweep stands: each of its jobs, by the events in `jobs.jsonl` and by the run folders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from omnilab.errors import DataError
from omnilab.runner.run_folder.lock import Holder, lock_state
from omnilab.runner.run_folder.names import DONE, FAILED, INTERRUPTED, KILLED, RUNNING, STATUS, UNREADABLE
from omnilab.runner.run_folder.reading import LoadedRun, find_runs
from omnilab.runner.sweeps.job_log import JOBS, PLANNED, RESUMED, Event, read_events
from omnilab.runner.sweeps.plan_file import PLAN, SweepPlan, read_plan

ATTEMPTS = "attempts"  # the folder for those of a job's folders that another attempt has taken the place of
TO_RESUME = (PLANNED, KILLED, INTERRUPTED, UNREADABLE)  # what a resumed sweep runs, beside failed jobs if it is told to
ENDED = (DONE, FAILED, INTERRUPTED, KILLED)


@dataclass(frozen=True)
class Job:
    """One job of a sweep."""

    number: int
    overrides: tuple[str, ...]
    folder: Path
    state: str = PLANNED  # or running, silent, done, failed, killed, interrupted, unreadable
    host: str | None = None
    pid: int | None = None
    error: str | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    identity: str | None = None
    started: str | None = None  # ISO 8601, by the clock of its host
    ended: str | None = None
    holder: Holder | None = None  # the process that ran it last

    @property
    def settings(self) -> dict[str, str]:
        """Its overrides by name."""
        return dict(override.split("=", 1) for override in self.overrides if "=" in override)


@dataclass(frozen=True)
class LoadedSweep:
    """A sweep folder, read."""

    folder: Path
    plan: SweepPlan | None  # None of a sweep of before
    jobs: list[Job]  # by their numbers
    damaged_lines: int = 0  # of `jobs.jsonl`

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many jobs there are of each state; of those that were not begun, as many as the plan says."""
        found: dict[str, int] = {}
        for job in self.jobs:
            found[job.state] = found.get(job.state, 0) + 1
        if self.unplanned:
            found[PLANNED] = found.get(PLANNED, 0) + self.unplanned
        return found

    @property
    def unplanned(self) -> int:
        """How many jobs are to come that the sweeper has not thought of yet."""
        return max(0, (self.plan.jobs or 0) - len(self.jobs)) if self.plan else 0


def load_sweep(folder: str | Path, unwritten: Iterable[Event] = ()) -> LoadedSweep:
    """The sweep in a folder; DataError if there is none.

    What a job's last event says is believed once it has ended; until then its run folder says how it stands.
    `unwritten`: events beside those on the disk.
    """
    path = Path(folder).resolve()
    if not (path / JOBS).is_file() and not unwritten:
        return _of_before(path)
    events, damaged = read_events(path) if (path / JOBS).exists() else ([], 0)
    jobs = jobs_of([*events, *unwritten], path)
    return LoadedSweep(path, read_plan(path), as_they_stand(jobs, path), damaged)


def jobs_of(events: Iterable[Event], folder: Path) -> list[Job]:
    """The jobs as their events tell of them, by number."""
    jobs: dict[int, Job] = {}
    tell(jobs, events, folder)
    return [jobs[number] for number in sorted(jobs)]


def tell(jobs: dict[int, Job], events: Iterable[Event], folder: Path) -> None:
    """Bring jobs, by number, up to date with what happened since."""
    for event in events:
        if event["event"] != RESUMED:
            number = event["job"]
            jobs[number] = _after(jobs.get(number) or Job(number, (), folder / str(number)), event)


def as_they_stand(jobs: Iterable[Job], folder: Path) -> list[Job]:
    """Jobs that had not ended by their events as their folders tell, of which those of planned jobs are not there yet."""
    with suppress(OSError):
        there = {path.name for path in folder.iterdir()}
        return [job if _is_to_come(job, folder, there) else _as_it_stands(job) for job in jobs]
    return [_as_it_stands(job) for job in jobs]


def _is_to_come(job: Job, folder: Path, there: set[str]) -> bool:
    return job.state == PLANNED and job.folder.parent == folder and job.folder.name not in there


def _after(job: Job, event: Event) -> Job:
    """The job after an event."""
    name = event["event"]
    if isinstance(below := event.get("folder"), str) and _is_within(below):
        job = replace(job, folder=job.folder.parent / below)
    if "overrides" in event and not job.overrides:
        job = replace(job, overrides=tuple(event["overrides"]))
    if name == PLANNED:
        return Job(job.number, job.overrides, job.folder)
    if name == RUNNING:
        holder = _holder(event.get("process"))
        host, pid = (holder.host, holder.pid) if holder else (None, None)
        began = Job(job.number, job.overrides, job.folder, holder=holder, host=host, pid=pid)
        return replace(began, state=RUNNING, started=_text(event, "time"))
    return replace(
        job,
        state=name,
        ended=_text(event, "time"),
        error=_text(event, "error"),
        metrics=_metrics(event.get("metrics")),
        identity=_text(event, "identity"),
    )


def _is_within(below: str) -> bool:
    """Whether a path leads to no other folder than one below."""
    return not Path(below).is_absolute() and ".." not in Path(below).parts and "\0" not in below and below != ""


def _text(event: Mapping[str, Any], name: str) -> str | None:
    value = event.get(name)
    return value if isinstance(value, str) else None


def _holder(content: Any) -> Holder | None:
    return Holder.of(content) if isinstance(content, dict) else None


def _metrics(content: Any) -> dict[str, float]:
    """Metrics as they were written: null stands for one without a value."""
    if not isinstance(content, dict):
        return {}
    return {
        name: math.nan if value is None else float(value)
        for name, value in content.items()
        if value is None or type(value) in (int, float)
    }


def _as_it_stands(job: Job) -> Job:
    """A job that had not ended by its events, as its folder, or its process, tells."""
    if job.state in ENDED:
        return job
    run = LoadedRun(job.folder)
    if (job.folder / STATUS).is_file():
        return _of_folder(job, run)
    if found := lock_state(job.folder):  # killed while it began
        return replace(job, state=found.state)
    if job.state == RUNNING and job.holder and job.started:
        return replace(job, state=job.holder.state(_seconds(job.started), free=False))
    return job


def _of_folder(job: Job, run: LoadedRun) -> Job:
    """A job as its run folder tells; one that is damaged hides no other."""
    try:
        state, status = run.state, run.status
        metrics = run.metrics if state == DONE else {}
        identity, overrides = run.manifest.get("identity"), tuple(run.manifest["overrides"])
    except DataError as error:
        return replace(job, state=UNREADABLE, error=str(error))
    return replace(
        job,
        overrides=job.overrides or overrides,
        state=state,
        metrics=metrics,
        identity=identity if isinstance(identity, str) else None,
        error=status["error"] if isinstance(status.get("error"), str) else None,
        ended=str(status.get("time")) if state in ENDED else None,
    )


def _seconds(iso: str) -> float:
    try:
        return datetime.fromisoformat(iso).timestamp()
    except ValueError:
        return 0.0


def _of_before(folder: Path) -> LoadedSweep:
    """A sweep of the version before, which has only the folders of its jobs."""
    if not folder.is_dir():
        raise DataError(f"there is no folder {folder}; omnilab sweep list shows the sweeps there are")
    runs = [run for run in find_runs(folder) if run.folder != folder and ATTEMPTS not in run.folder.parts]
    if not runs and not (folder / PLAN).is_file():
        raise DataError(f"{folder} holds no sweep (no {JOBS}, no jobs); omnilab sweep list shows the sweeps there are")
    named = sorted(runs, key=lambda run: int(run.folder.name) if run.folder.name.isdigit() else 0)
    jobs = [_of_folder(Job(number, (), run.folder), run) for number, run in enumerate(named)]
    return LoadedSweep(folder, read_plan(folder), jobs)
