"""Bodies of requests have a size and a time."""

from __future__ import annotations

import asyncio

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from omnilab_serve.security.gate import refused

MOST_BYTES, MOST_S = 1_000_000, 10.0


class BoundedBodies:
    """Reads a body before the routes are asked; what is too large, or does not come, is refused."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan" or not _has_body(Request(scope)):
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        try:
            async with asyncio.timeout(MOST_S):
                body = await _read(request, receive)
        except TimeoutError:
            await refused(request, 408, f"the body did not come within {MOST_S:.0f} s")(scope, receive, send)
            return
        if body is None:
            await refused(request, 413, f"the body is larger than {MOST_BYTES} bytes")(scope, receive, send)
            return
        await self._app(scope, _replay(body, receive), send)


def _has_body(request: Request) -> bool:
    return "transfer-encoding" in request.headers or request.headers.get("content-length", "0") != "0"


async def _read(request: Request, receive: Receive) -> list[Message] | None:
    """The messages of the body, the last may be that the client has gone; None for one that is too large."""
    if int(request.headers.get("content-length", "0")) > MOST_BYTES:  # h11 has seen that it is a number
        return None
    messages, size = [], 0
    while True:
        message = await receive()
        size += len(message.get("body", b""))
        if size > MOST_BYTES:
            return None
        messages.append(message)
        if not message.get("more_body", False):
            return messages


def _replay(body: list[Message], receive: Receive) -> Receive:
    async def again() -> Message:
        return body.pop(0) if body else await receive()

    return again
