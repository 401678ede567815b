"""The embedded Rerun viewer, from our own origin, and the recordings that it shows."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse

from omnilab.errors import DataError
from omnilab.runner.run_folder import RUNNING
from omnilab_serve.rendering import page
from omnilab_serve.run_details.files import RECORDING, open_file
from omnilab_serve.service import Here, NotThereError
from omnilab_serve.viewer import WebViewer, follow

router = APIRouter(include_in_schema=False)
viewer = WebViewer()
FOREVER = "public, max-age=31536000, immutable"
POLICY = (  # of the viewer's page alone: it is WebAssembly. What it says to hosts of its makers is stopped here
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; connect-src 'self'; img-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
BYTES = {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "sandbox; default-src 'none'"}


@router.get("/viewer-files/{version}/{name}")
def viewer_file(version: str, name: str) -> Response:
    if version != viewer.version:
        raise NotThereError(f"the viewer is of version {viewer.version}, not {version}; load the page anew")
    try:
        kind, file = viewer.file(name)
    except KeyError:
        raise NotThereError(f"the viewer has no file {name}") from None
    headers = {"Content-Encoding": "gzip", "Cache-Control": FOREVER, "X-Content-Type-Options": "nosniff"}
    return FileResponse(file, media_type=kind.media_type, headers=headers)


@router.get("/viewer/{path:path}")
def run_viewer(request: Request, path: str, service: Here) -> HTMLResponse:
    service.run(path)
    return viewer_page(request, f"/recording/{path}/{RECORDING}")


def viewer_page(request: Request, recording: str) -> HTMLResponse:
    """A page with nothing but the viewer, which shows the recording at a path of ours, whose name ends in .rrd."""
    problem = ""
    try:
        viewer.ready()
    except DataError as error:
        problem = str(error)
    content = {"recording": recording, "version": viewer.version, "problem": problem}
    shown = page(request, "viewer.html", 422 if problem else 200, **content)
    shown.headers["Content-Security-Policy"] = POLICY
    shown.headers["X-Frame-Options"] = "SAMEORIGIN"
    return shown


@router.get("/recording/{path:path}")
@router.get(
    "/recording/{path:path}/" + RECORDING
)  # the viewer asks what a name ends with; the lower route is the first
def recording(request: Request, path: str, service: Here) -> StreamingResponse:
    """A run's recording, followed while the run goes on."""
    run = service.run(path)
    if run.state != RUNNING:
        try:
            open_file(run.folder / RECORDING).close()
        except OSError as error:
            raise NotThereError(
                f"{path} has no recording that can be read; run the experiment with sink@sinks.rerun=rerun"
            ) from error
    headers = BYTES | {"Cache-Control": "no-store"}
    return StreamingResponse(follow(run.folder, request.is_disconnected), 200, headers, "application/octet-stream")
