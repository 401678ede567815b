"""All sweeps."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from omnilab_serve.rendering import page
from omnilab_serve.service import Here, NotThereError

router = APIRouter(include_in_schema=False)
AT_ONCE = 100  # rows


@router.get("/sweeps")
def sweep_list(request: Request, service: Here) -> HTMLResponse:
    sweeps = service.index.sweeps()
    return page(request, "sweep_list.html", sweeps=sweeps[:AT_ONCE], offset=0, total=len(sweeps), at_once=AT_ONCE)


@router.get("/parts/sweeps")
def sweep_rows(request: Request, service: Here, offset: int = 0, more: bool = False) -> HTMLResponse:
    """A hundred rows; `more`: and where the next will stand."""
    sweeps, at = service.index.sweeps(), max(0, offset)
    return page(
        request, "part_sweep_rows.html", sweeps=sweeps[at : at + AT_ONCE], offset=at, total=len(sweeps),
        at_once=AT_ONCE, more=more,
    )  # fmt: skip


@router.get("/parts/sweep/{path:path}")
def sweep_row(request: Request, service: Here, path: str) -> HTMLResponse:
    """The row of one sweep."""
    sweep = next((sweep for sweep in service.index.sweeps() if sweep.path == path), None)
    if sweep is None:
        raise NotThereError(f"there is no sweep {path} in the logs")
    return page(request, "part_sweep_row.html", sweep=sweep)
