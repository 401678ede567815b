"""A run: how it stands, its recording, figures, metrics, configuration, log."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(include_in_schema=False)
