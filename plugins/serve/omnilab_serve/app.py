"""The application: pages, API and what keeps strangers out, around one service."""

from __future__ import annotations

import secrets

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from omnilab import __version__
from omnilab.errors import OmnilabError
from omnilab_serve import api, pages
from omnilab_serve.composing import SettingError
from omnilab_serve.rendering import STATIC, page
from omnilab_serve.security import protect
from omnilab_serve.service import NotThereError, Service
from omnilab_serve.settings import ServeSettings

ROUTERS = (*pages.ROUTERS, *api.ROUTERS)


def create_app(settings: ServeSettings) -> FastAPI:
    """The application for one folder of logs; its service watches and works once it is started."""
    service = Service(settings)
    app = FastAPI(
        title="omnilab", version=__version__, docs_url=None, redoc_url=None, openapi_url="/api/openapi.json",
        telemetry={"tracing": False, "metrics": False, "logs": False, "auto_configure": False},
    )  # fmt: skip
    app.state.service = service
    app.state.csrf = secrets.token_urlsafe(32)
    for router in ROUTERS:
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    for kind in (OmnilabError, HTTPException, RequestValidationError):
        app.add_exception_handler(kind, refused)
    protect(app, settings)
    return app


def refused(request: Request, error: Exception) -> Response:
    """A user's mistake: its sentence, as a page or as JSON."""
    status, sentence = described(error)
    if request.url.path.startswith("/api/"):
        setting = {"field": error.setting} if isinstance(error, SettingError) else {}
        return JSONResponse({"detail": sentence, **setting}, status)
    name = "part_error.html" if "hx-request" in request.headers else "error.html"
    return page(request, name, status, sentence=sentence)


def described(error: Exception) -> tuple[int, str]:
    """The status and the sentence of a mistake."""
    if isinstance(error, HTTPException):
        return error.status_code, "there is nothing at this address" if error.status_code == 404 else str(error.detail)
    if isinstance(error, RequestValidationError):
        found = error.errors()[0]
        return 422, f"{'.'.join(map(str, found['loc'][1:]))}: {found['msg']}"
    return 404 if isinstance(error, NotThereError) else 422, str(error)
