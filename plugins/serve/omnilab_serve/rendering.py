"""Pages from templates: everything is escaped, nothing of a run is ever markup."""

from __future__ import annotations

import shlex
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.requests import Request
from starlette.responses import HTMLResponse

from omnilab_serve.comparing.charts import color_of
from omnilab_serve.comparing.words import meaning_of
from omnilab_serve.run_view import own_overrides, setting_text, title, value_of
from omnilab_serve.words import ago, cell, duration, figure, file_size, headline_metrics

STATIC = Path(__file__).parent / "static"


@cache
def templates() -> Environment:
    """The templates, with what they may call."""
    environment = Environment(
        loader=PackageLoader("omnilab_serve"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "ago": ago,
        "cell": cell,
        "color": color_of,
        "duration": duration,
        "figure": figure,
        "file_size": file_size,
        "headline": headline_metrics,
        "meaning": meaning_of,
        "column_title": title,
        "own_overrides": own_overrides,
        "setting_text": setting_text,
        "value_of": value_of,
        "shell": shlex.join,
        "path": lambda text: quote(str(text), safe="/"),
    }
    return environment


def page(request: Request, name: str, status: int = 200, **content: Any) -> HTMLResponse:
    """A page, or a part of one, of a template."""
    state = request.app.state
    text = (
        templates()
        .get_template(name)
        .render(request=request, settings=state.service.settings, csrf=state.csrf, place=request.url.path, **content)
    )
    return HTMLResponse(text.encode("utf-8", "replace"), status)  # JSON can say halves of characters


def login_page(status: int = 200, sentence: str = "", entered: bool = False) -> HTMLResponse:
    """The page for the token: nothing of the service stands in it."""
    text = templates().get_template("login.html").render(sentence=sentence, entered=entered)
    return HTMLResponse(text, status, {"Referrer-Policy": "same-origin"})  # else browsers send the form without origin
