"""The first page: all runs."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from omnilab.client import RunPage
from omnilab.errors import ConfigError
from omnilab_serve.index.query import parse
from omnilab_serve.index.records import run_record
from omnilab_serve.rendering import page
from omnilab_serve.run_view import DEFAULT, STANDARD, UNSORTED, RunView, Shown
from omnilab_serve.service import Here, Service

router = APIRouter(include_in_schema=False)
AT_ONCE = 100  # rows


@router.get("/")
def run_list(request: Request, service: Here, view: Shown) -> HTMLResponse:
    """All of the page. Of a filter that cannot be read the sentence alone is taken: the rows stay what they were."""
    content = _content(service, view)
    answer = page(request, "run_list.html", **content)
    if content["why"]:
        answer.headers["HX-Reswap"] = "none"
    return answer


@router.get("/parts/runs")
def run_rows(request: Request, service: Here, view: Shown, offset: int = 0, more: bool = False) -> HTMLResponse:
    """A hundred rows; `more`: and where the next will stand."""
    return page(request, "part_run_rows.html", more=more, **_content(service, view, max(0, offset)))


@router.get("/parts/run-count")
def run_count(request: Request, service: Here, view: Shown) -> HTMLResponse:
    return page(request, "part_run_count.html", **_content(service, view))


@router.get("/parts/columns")
def columns(request: Request, service: Here, view: Shown) -> HTMLResponse:
    """What columns there are to choose from."""
    names = service.index.names()
    return page(request, "part_columns.html", view=view, standard=STANDARD, names=names)


@router.get("/parts/run/{path:path}")
def run_row(request: Request, service: Here, view: Shown, path: str) -> HTMLResponse:
    """The row of one run."""
    run = service.index.run(path) or run_record(service.run(path), service.settings.logs)
    return page(request, "part_run_row.html", run=run, view=view)


def _content(service: Service, view: RunView, offset: int = 0) -> dict[str, Any]:
    """What templates show of a view."""
    why = hint = ""
    try:
        found = service.index.search(view.q, view.sort, offset, AT_ONCE)
    except ConfigError as error:
        found, why = RunPage(0), str(error)
    if not found.total and view.q and not why:
        hint = _hint(service, view.q)
    return {
        "found": found, "view": view, "offset": offset, "at_once": AT_ONCE, "why": why, "hint": hint,
        "default": DEFAULT, "standard": STANDARD, "unsorted": UNSORTED, "all": len(service.index.runs()), "complete": service.index.is_complete,
    }  # fmt: skip


def _hint(service: Service, q: str) -> str:
    """Why a filter may match nothing: a name in it that no run has."""
    unknown = parse(q).unknown(service.index.runs())
    if not unknown:
        return ""
    names = service.index.names()
    known = {*names.metrics, *names.settings, *(name.rpartition(".")[2] for name in names.settings)}
    close = get_close_matches(unknown[0], known, 1)
    return f"no run has a setting, metric or component slot called {unknown[0]}" + (
        f"; is it {close[0]}?" if close else ""
    )
