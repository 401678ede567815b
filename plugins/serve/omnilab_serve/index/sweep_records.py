"""Records of sweeps, from their folders."""

from __future__ import annotations

from omnilab.client import SweepRecord
from omnilab.runner.sweeps.snapshot import Snapshot
from omnilab.runner.sweeps.status_table import state


def sweep_record(seen: Snapshot, path: str) -> SweepRecord:
    """A sweep as it was seen, without its jobs; `path`: of its folder, below the logs."""
    plan = seen.sweep.plan
    return SweepRecord(
        path,
        state(seen),
        experiment=plan.experiment if plan else "",
        command=plan.command if plan else [],
        parameters=plan.parameters if plan else {name: [] for name in seen.parameters},
        counts=seen.sweep.counts,
        goes_on=seen.goes_on,
        fraction=seen.fraction,
        left_s=seen.left_s,
        started=plan.time if plan else min((job.started for job in seen.sweep.jobs if job.started), default=None),
    )
