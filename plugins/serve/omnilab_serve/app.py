"""The application: pages, API and what keeps strangers out, around one service."""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from omnilab import __version__
from omnilab.errors import OmnilabError
from omnilab_serve import api, pages
from omnilab_serve.rendering import STATIC, page
from omnilab_serve.security import protect
from omnilab_serve.service import NotThereError, Service
from omnilab_serve.settings import ServeSettings

ROUTERS = (*pages.ROUTERS, *api.ROUTERS)


def create_app(settings: ServeSettings) -> FastAPI:
    """The application for one folder of logs; it watches and works between its startup and its shutdown."""
    service = Service(settings)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        service.start()
        try:
            yield
        finally:
            service.stop()

    app = FastAPI(
        title="omnilab", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None,
        openapi_url="/api/openapi.json",
    )  # fmt: skip
    app.state.service = service
    app.state.csrf = secrets.token_urlsafe(32)
    for router in ROUTERS:
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_exception_handler(OmnilabError, refused)
    protect(app, settings)
    return app


def refused(request: Request, error: Exception) -> Response:
    """A user's mistake: its sentence, as a page or as JSON."""
    status = 404 if isinstance(error, NotThereError) else 422
    if request.url.path.startswith("/api/"):
        return JSONResponse({"detail": str(error)}, status)
    name = "part_error.html" if "hx-request" in request.headers else "error.html"
    return page(request, name, status, sentence=str(error))
