"""The first page: all runs."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from omnilab_serve.rendering import page
from omnilab_serve.service import Here

router = APIRouter(include_in_schema=False)


@router.get("/")
def run_list(request: Request, service: Here, q: str = "", sort: str = "-started") -> HTMLResponse:
    return page(request, "run_list.html", found=service.index.search(q, sort), q=q, sort=sort)


@router.get("/parts/runs")
def run_rows(request: Request, service: Here, q: str = "", sort: str = "-started", offset: int = 0) -> HTMLResponse:
    return page(request, "part_run_rows.html", found=service.index.search(q, sort, offset), q=q, sort=sort)
