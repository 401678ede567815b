"""A sweep: its jobs as a grid, figures, resume and stop."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(include_in_schema=False)
