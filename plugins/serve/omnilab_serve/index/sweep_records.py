"""Records of sweeps, from their folders."""

from __future__ import annotations

from omnilab.client import SweepRecord
from omnilab.runner.sweeps.snapshot import Snapshot
from omnilab.runner.sweeps.status_table import state
from omnilab_serve.index.records import encodable, time_in_name


def sweep_record(seen: Snapshot, path: str) -> SweepRecord:
    """A sweep as it was seen, without its jobs; `path`: of its folder, below the logs."""
    plan = seen.sweep.plan
    return SweepRecord(
        path,
        state(seen),
        experiment=encodable(plan.experiment) if plan else "",
        command=encodable(plan.command) if plan else [],
        parameters=encodable(plan.parameters if plan else _parameters(seen)),
        counts=seen.sweep.counts,
        goes_on=seen.goes_on,
        fraction=seen.fraction,
        left_s=seen.left_s,
        started=encodable(plan.time) if plan else _started(seen),
    )


def _parameters(seen: Snapshot) -> dict[str, list[str]]:
    """What differs between the jobs of a sweep of before, which has no plan."""
    settings = [job.settings for job in seen.sweep.jobs]
    return {name: list(dict.fromkeys(own[name] for own in settings if name in own)) for name in seen.parameters}


def _started(seen: Snapshot) -> str | None:
    """When a sweep of before began, by its folder's name or its jobs."""
    times = [time for job in seen.sweep.jobs if (time := job.started or job.ended)]
    return time_in_name(seen.sweep.folder.name) or min(times, default=None)
