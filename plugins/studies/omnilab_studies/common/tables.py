"""Tables: rows to columns, columns and metrics to Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from omnilab.api import Metric


def columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Rows of the same keys as columns by name."""
    return {key: [row[key] for row in rows] for key in rows[0]}


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """Columns by name as a Markdown table, numbers with four digits."""
    head = [f"| {' | '.join(name.replace('_', ' ') for name in table)} |", f"|{'---|' * len(table)}"]
    rows = [f"| {' | '.join(_brief(cell) for cell in row)} |" for row in zip(*table.values(), strict=True)]
    return "\n".join([*head, *rows])


def _brief(cell: Any) -> str:
    if not isinstance(cell, float):
        return str(cell)
    return "–" if math.isnan(cell) else f"{cell:.4g}"


def markdown_table(metrics: list[Metric], title: str) -> str:
    """Metrics as a Markdown document with a title, for the viewer."""
    rows = [f"| {m.name.replace('_', ' ')} | {_measured(m)} |" for m in metrics]
    return "\n".join([f"## {title}", "", "| | |", "|---|---|", *rows])


def _measured(metric: Metric) -> str:
    """Value and unit, or why there is no value."""
    if math.isnan(metric.value):
        return f"– {metric.note}".rstrip()
    return f"{metric.value:.4g} {'' if metric.unit == '1' else metric.unit}"
