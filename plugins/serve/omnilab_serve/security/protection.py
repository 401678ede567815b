"""The layers that every request passes, and what is said of errors."""

from __future__ import annotations

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import Response

from omnilab_serve.security.access import Access
from omnilab_serve.security.bodies import BoundedBodies
from omnilab_serve.security.gate import RequestGate, refused
from omnilab_serve.security.response_headers import ResponseHeaders, add_headers
from omnilab_serve.settings import ServeSettings


def protect(app: FastAPI, settings: ServeSettings) -> None:
    """Put the layers around an application, the innermost first."""
    app.state.access = Access(settings.token, settings.port)
    app.add_middleware(BoundedBodies)
    app.add_middleware(RequestGate, settings=settings, access=app.state.access, csrf=app.state.csrf)
    app.add_middleware(ResponseHeaders)
    app.add_exception_handler(Exception, failed)


def failed(request: Request, _: Exception) -> Response:
    """A bug: its traceback goes to standard error, by the server, and none of it to the client."""
    response = refused(
        request, 500, "that is a mistake in omnilab, not yours; its traceback is on the service's terminal"
    )
    add_headers(response.headers, request.url.path)  # this response passes no layer
    return response
