"""Runs, as data."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from omnilab.client import RunPage, RunRecord
from omnilab_serve.index.records import run_record
from omnilab_serve.service import Here

router = APIRouter(prefix="/api/runs", tags=["runs"])
MOST = 1000  # runs in one answer


@router.get("")
def runs(
    service: Here,
    q: str = "",
    sort: str = "-started",
    offset: Annotated[int, Query(ge=0)] = 0,
    limit: Annotated[int, Query(ge=0, le=MOST)] = 100,
) -> RunPage:
    """Runs that a filter matches, as on the first page, by any metric, setting or field (`-` before it: largest first)."""
    return service.index.search(q, sort, offset, limit)


@router.get("/{path:path}")
def run(service: Here, path: str) -> RunRecord:
    """One run, as its folder tells now."""
    return run_record(service.run(path), service.settings.logs)
