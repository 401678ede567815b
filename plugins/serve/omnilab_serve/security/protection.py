"""The layers that every request passes, outermost last."""

from __future__ import annotations

from fastapi import FastAPI
from starlette.middleware.trustedhost import TrustedHostMiddleware

from omnilab_serve.settings import ServeSettings


def protect(app: FastAPI, settings: ServeSettings) -> None:
    """Put the layers around an application."""
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=settings.hosts, www_redirect=False)
