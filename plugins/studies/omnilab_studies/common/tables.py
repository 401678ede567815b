"""Tables as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """A table as Markdown, numbers with four digits."""
    head = [f"| {' | '.join(name.replace('_', ' ') for name in table)} |", f"|{'---|' * len(table)}"]
    rows = [f"| {' | '.join(_brief(cell) for cell in row)} |" for row in zip(*table.values(), strict=True)]
    return "\n".join([*head, *rows])


def _brief(cell: Any) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
