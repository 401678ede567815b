"""Sweeps, as data."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import APIRouter

from omnilab.client import SweepRecord
from omnilab_serve.service import Here

router = APIRouter(prefix="/api/sweeps", tags=["sweeps"])


@router.get("")
def sweeps(service: Here) -> Sequence[SweepRecord]:
    """All sweeps, the newest first, without their jobs."""
    return service.index.sweeps()
