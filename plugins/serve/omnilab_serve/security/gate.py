"""Requests are let through that are ours: called by our name, from our own pages or no page, by who may come in."""

from __future__ import annotations

import hmac
import ipaddress
import re
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from omnilab_serve.rendering import login_page
from omnilab_serve.security.access import WINDOW_S, Access
from omnilab_serve.settings import EVERY_ADDRESS, ServeSettings

SAFE_METHODS = {"GET", "HEAD", "OPTIONS"}  # which change nothing
HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([a-z0-9._-]+))(?::\d{1,5})?", re.IGNORECASE)
MOST_URL = 8000  # bytes
LOGIN = "/login"


class RequestGate:
    """Refuses, in a sentence, what others forge; an ASGI layer that leaves responses alone."""

    def __init__(self, app: ASGIApp, settings: ServeSettings, access: Access, csrf: str) -> None:
        self._app, self._access, self._csrf = app, access, csrf
        self._hosts, self._any_address = settings.hosts, settings.host in EVERY_ADDRESS

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        await (self.refusal(request) or self._app)(scope, receive, send)

    def refusal(self, request: Request) -> Response | None:
        """The answer to a request that is not let through."""
        if not self._is_our_name(request.headers.get("host", "")):
            return refused(request, 400, "this service has another name; start it with --name NAME to call it so")
        if is_from_elsewhere(request):
            return refused(request, 403, "this request was made by a page of another site, which may not")
        if len(request.scope["raw_path"]) + len(request.scope["query_string"]) > MOST_URL:
            return refused(request, 414, f"the address is longer than {MOST_URL} bytes")
        return self._by_token(request)

    def _is_our_name(self, host: str) -> bool:
        """Whether a Host names this service: pages of others reach it by names of their own (DNS rebinding)."""
        found = HOST.fullmatch(host)
        name = (found[1] or found[2]).lower() if found else ""
        return name in self._hosts or (self._any_address and is_address(name))

    def _by_token(self, request: Request) -> Response | None:
        if request.url.path == LOGIN or request.url.path.startswith("/static/"):
            return None
        if "authorization" in request.headers and not self._access.is_open:
            if self._access.is_guessing(request):
                return refused(request, 429, f"too many wrong tokens; try again in {WINDOW_S:.0f} s")
            if self._access.by_header(request):
                return None  # no page of another site knows it, so nothing else is needed
            return refused(request, 401, "the token is wrong; `omnilab serve` prints it")
        if not self._access.is_open and not self._access.by_cookie(request):
            return login_needed(request)
        return self._by_csrf(request)

    def _by_csrf(self, request: Request) -> Response | None:
        given = request.headers.get("x-csrf-token", "")
        if request.method in SAFE_METHODS or hmac.compare_digest(given.encode(), self._csrf.encode()):
            return None
        return refused(
            request, 403, "this page is from before the service was started; load it again"
            if given else "a change needs the header X-CSRF-Token, which GET /api/session tells",
        )  # fmt: skip


def is_from_elsewhere(request: Request) -> bool:
    """Whether a page of another origin sent it; links that are followed in a window of their own are no harm."""
    headers = request.headers
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site not in {None, "same-origin", "none"}:
        followed = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
        return request.method != "GET" or not followed
    return origin is not None and urlsplit(origin).netloc.lower() != headers["host"].lower()


def is_address(name: str) -> bool:
    """Whether it is an IP address, which no one can point elsewhere."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def login_needed(request: Request) -> Response:
    """The login page, in the place of any other."""
    if request.url.path.startswith("/api/"):
        return refused(request, 401, "a token is needed: Authorization: Bearer TOKEN; `omnilab serve` prints it")
    response = login_page(401)
    response.headers["HX-Refresh"] = "true"  # a part of a page asks; the page is loaded again, and is the form
    return response


def refused(request: Request, status: int, sentence: str) -> Response:
    """A sentence, without anything of a page in it; the connection ends, whatever else was to come on it."""
    headers = {"Connection": "close"} | ({"WWW-Authenticate": "Bearer"} if status == 401 else {})
    if request.url.path.startswith("/api/"):
        return JSONResponse({"detail": sentence}, status, headers)
    return PlainTextResponse(sentence + "\n", status, headers)
