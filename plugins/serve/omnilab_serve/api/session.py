"""The token by which changes are asked for, and what answers."""

from __future__ import annotations

from fastapi import APIRouter, Request

from omnilab import __version__
from omnilab.client import Session

router = APIRouter(prefix="/api/session", tags=["session"])


@router.get("")
def session(request: Request) -> Session:
    """What a client needs first. Another site's page can ask for it as little as for anything else."""
    return Session(__version__, request.app.state.csrf)
