"""How the table of runs is shown: filter, order and columns, as the address has them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import Depends, Query

from omnilab.client import RunRecord
from omnilab_serve.index.run_table import NEWEST_FIRST
from omnilab_serve.index.values import values
from omnilab_serve.words import figure

STANDARD = {  # columns beside those of metrics and settings
    "overrides": "Overrides",
    "main": "Main metrics",
    "started": "When",
    "seconds": "Took",
    "host": "Host",
    "sweep": "Sweep",
}
DEFAULT = ("overrides", "main", "started", "seconds", "host")
UNSORTED = ("overrides", "main")
NOISE = ("logs=", "cache=", "cache_gb=", "hydra.", "hydra/", "resume=", "retry_failed=")
MOST_COLUMNS, LONGEST_NAME, MOST_WORDS = 40, 200, 20


@dataclass(frozen=True)
class RunView:
    """A way of showing runs."""

    q: str = ""
    sort: str = NEWEST_FIRST
    columns: Sequence[str] = DEFAULT

    def parameters(self, **changes: Any) -> str:
        """The query of an address, without what is so by default; `changes` beside what is here."""
        fields = {name: value for name, value in changes.items() if name in ("q", "sort", "columns")}
        view = replace(self, **fields)
        pairs = [("q", view.q)] if view.q else []
        pairs += [("sort", view.sort)] if view.sort != NEWEST_FIRST else []
        pairs += [("column", name) for name in view.columns] if tuple(view.columns) != DEFAULT else []
        return urlencode([*pairs, *((name, value) for name, value in changes.items() if name not in fields)])

    def address(self, **changes: Any) -> str:
        """That of the page."""
        parameters = self.parameters(**changes)
        return f"/?{parameters}" if parameters else "/"

    def sorted_by(self, name: str) -> str:
        """The order after a click on a column: up and down in turn; times and metrics begin with the largest."""
        up, down = name, f"-{name}"
        if self.sort == down:
            return up
        return down if self.sort == up or name in ("started", "seconds") else up

    def direction(self, name: str) -> str:
        """Of a column, as ARIA has it; "" if it is not what rows are sorted by."""
        return {name: "ascending", f"-{name}": "descending"}.get(self.sort, "")


def _view(
    q: str = "", sort: str = NEWEST_FIRST, column: Annotated[Sequence[str], Query()] = ()
) -> RunView:  # the order of an address without one is the newest first
    named = [name[:LONGEST_NAME] for name in dict.fromkeys(column) if name][:MOST_COLUMNS]
    return RunView(q, sort[:LONGEST_NAME] or NEWEST_FIRST, named or DEFAULT)


Shown = Annotated[RunView, Depends(_view)]


def title(name: str) -> str:
    """What stands above a column: of a setting its last word."""
    return STANDARD.get(name) or name.rpartition(".")[2] or name


def own_overrides(record: RunRecord) -> list[str]:
    """What was overridden, without what changes no result."""
    own = [word for word in record.overrides if not word.lstrip("+~").startswith(NOISE)]
    return own if len(own) <= MOST_WORDS else [*own[:MOST_WORDS], f"and {len(own) - MOST_WORDS} more"]


def value_of(record: RunRecord, name: str) -> Any:
    """What stands in a column of metrics or settings; None where there is nothing."""
    return next(iter(values(record, name)), None)


def setting_text(value: Any) -> str:
    """A value in a cell: numbers as elsewhere, anything else as an override would say it."""
    if value is None or isinstance(value, str):
        return (value or "")[:LONGEST_NAME]
    if type(value) in (int, float):
        return str(value) if type(value) is int else figure(value)
    return json.dumps(value, ensure_ascii=False)[:LONGEST_NAME]
