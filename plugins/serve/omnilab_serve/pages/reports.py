"""Reports to be saved: of a run or a sweep, one HTML file that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter
from starlette.responses import FileResponse

from omnilab_serve.comparing.cached_files import FileCache
from omnilab_serve.comparing.documents import SIGNS, comparison_key
from omnilab_serve.service import Here

router = APIRouter(include_in_schema=False)
REPORTS = FileCache("reports", ".html", kept=20)
HEADERS = {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "sandbox; default-src 'none'"}


@router.get("/reports/{path:path}")
def report(path: str, service: Here) -> FileResponse:
    return report_file(service.folder(path))


def report_file(folder: Path) -> FileResponse:
    """What `omnilab report` writes of a run or sweep, for saving: never a page of our origin."""
    key = comparison_key([folder], (*SIGNS, "run.log", "sweep.yaml"))
    REPORTS.make(key, lambda target: ["report", str(folder), "--output", str(target)])
    name = quote(f"{folder.name}-report.html")
    headers = HEADERS | {"Content-Disposition": f"attachment; filename*=UTF-8''{name}"}
    return FileResponse(REPORTS.file(key), media_type="text/html; charset=utf-8", headers=headers)
