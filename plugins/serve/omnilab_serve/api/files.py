"""The files of a run, and the end of its log, as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Query

from omnilab.client import LogTail, RunFile
from omnilab_serve.run_details.files import run_files
from omnilab_serve.run_details.log_text import LINES, log_tail
from omnilab_serve.service import Here

router = APIRouter(prefix="/api", tags=["runs"])


@router.get("/files/{path:path}")
def list_files(path: str, service: Here) -> Sequence[RunFile]:
    """The files of a run; each is at /files/PATH/NAME."""
    return run_files(service.run(path).folder)


@router.get("/log/{path:path}")
def tail_log(path: str, service: Here, lines: Annotated[int, Query(ge=0, le=10_000)] = LINES) -> LogTail:
    """The last lines of a run's log."""
    return log_tail(service.run(path).folder, lines)
