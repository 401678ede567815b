"""The embedded Rerun viewer, from our own origin, and the recordings that it shows."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(include_in_schema=False)
