"""Comparisons, as data."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from omnilab_serve.pages.compare import RunPaths, folders
from omnilab_serve.service import Here

router = APIRouter(prefix="/api/compare", tags=["compare"])


@router.get("")
def compare(service: Here, runs: RunPaths) -> dict[str, Any]:
    """What `omnilab compare --json` says of runs and sweeps: docs/comparing.md has every key; of each run, its path."""
    return service.comparisons.document(folders(service, runs))
