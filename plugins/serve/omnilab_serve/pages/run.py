"""A run: how it stands, its recording, figures, metrics, configuration, log, files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from io import FileIO
from pathlib import PurePosixPath
from urllib.parse import quote

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from omnilab.errors import DataError
from omnilab.runner.run_folder.names import CONFIG
from omnilab_serve.index.records import run_record
from omnilab_serve.rendering import page
from omnilab_serve.run_details import files
from omnilab_serve.run_details.details import RunDetails, figure_title
from omnilab_serve.service import Here, NotThereError

router = APIRouter(include_in_schema=False)
STRANGE = {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "sandbox; default-src 'none'"}


@router.get("/runs/{path:path}")
def run_page(request: Request, path: str, service: Here) -> HTMLResponse:
    run = service.run(path)
    details = RunDetails(run, run_record(run, service.settings.logs))
    return page(request, "run.html", details=details, run=details.record, figure_title=figure_title)


@router.get("/parts/run-settings/{path:path}")
def all_settings(request: Request, path: str, service: Here) -> HTMLResponse:
    run = service.run(path)
    try:
        text = run.parsed(CONFIG, str)
    except DataError as error:
        text = str(error)
    return page(request, "part_text.html", text=text)


@router.get("/files/{path:path}")
def file(path: str, service: Here) -> Response:
    """A file of a run: a picture, a text, or bytes to be saved; never a page of our origin."""
    found = files.file_of(path, service.settings.logs)
    if found is None:
        raise NotThereError(f"there is no file {path} in the logs")
    size, begins = os.fstat(found.fileno()).st_size, os.pread(found.fileno(), len(files.PNG), 0)
    kind = files.media_type(path, begins)
    headers = STRANGE | {"Content-Length": str(size), "Cache-Control": "no-cache"}
    if kind == files.BYTES:
        headers["Content-Disposition"] = f"attachment; filename*=UTF-8''{quote(PurePosixPath(path).name)}"
    return OpenFileResponse(found, size, headers, kind)


class OpenFileResponse(StreamingResponse):
    """The first bytes of an open file, which is closed at the end, also when the browser is gone before the first is sent."""

    def __init__(self, file: FileIO, size: int, headers: Mapping[str, str], kind: str) -> None:
        super().__init__(files.content(file, size), 200, headers, kind)
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._file.close()
