"""The form for the token, and the cookie that stands for it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from starlette.responses import Response

from omnilab_serve.rendering import login_page
from omnilab_serve.security import Access

router = APIRouter(include_in_schema=False)


@router.get("/login")
def login(request: Request, token: str = "") -> Response:
    """The form; with a token, as in the address that `omnilab serve` prints, at once what it leads to."""
    return entered(request, token) if token else login_page()


@router.post("/login")
def login_by_form(request: Request, token: Annotated[str, Form()] = "") -> Response:
    return entered(request, token)


def entered(request: Request, token: str) -> Response:
    """A page that goes on to the first one by itself: a browser that came by another site's link sends the cookie then."""
    access: Access = request.app.state.access
    if access.is_guessing(request):
        return login_page(429, "Too many wrong tokens; wait a minute.")
    if not access.is_open and not access.try_token(request, token.strip()):
        return login_page(401, "That is not the token; omnilab serve prints it.")
    response = login_page(entered=True)
    response.set_cookie(access.cookie_name, access.cookie_value, httponly=True, samesite="strict", max_age=30 * 86400)
    return response
