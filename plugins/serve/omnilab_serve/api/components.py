"""Components, recipes and checks of overrides, as data."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(prefix="/api", tags=["components"])
