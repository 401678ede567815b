"""Reports, as files."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.responses import FileResponse

from omnilab_serve.pages.reports import report_file
from omnilab_serve.service import Here

router = APIRouter(prefix="/api/reports", tags=["reports"])


@router.get("/{path:path}", response_class=FileResponse)
def report(path: str, service: Here) -> FileResponse:
    """A run or a sweep as one HTML file, as `omnilab report` writes it."""
    return report_file(service.folder(path))
