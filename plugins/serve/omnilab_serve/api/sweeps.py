"""Sweeps, as data."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import APIRouter

from omnilab.client import SweepRecord
from omnilab_serve.service import Here
from omnilab_serve.sweeps.watched import sweep_with_jobs

router = APIRouter(prefix="/api/sweeps", tags=["sweeps"])


@router.get("")
def sweeps(service: Here) -> Sequence[SweepRecord]:
    """All sweeps, the newest first, without their jobs."""
    return service.index.sweeps()


@router.get("/{path:path}")
def sweep(path: str, service: Here) -> SweepRecord:
    """A sweep as it stands, with its jobs."""
    return sweep_with_jobs(service.watched.snapshot(service.sweep(path).folder), service.path)
