"""Who may come in, and the token by which changes are asked for."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(prefix="/api/session", tags=["session"])
