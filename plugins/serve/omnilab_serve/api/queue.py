"""The queue, as data."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(prefix="/api/submissions", tags=["queue"])
