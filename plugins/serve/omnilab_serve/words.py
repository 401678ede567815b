"""Numbers, times and durations as a reader wants them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime

MAIN = 3  # metrics of a run in a row of a table


def figure(value: float | None) -> str:
    """A number in four digits; an en dash where there is none."""
    if value is None or math.isnan(value):
        return "–"
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.3g}"
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def cell(text: str) -> str:
    """What stands in a table of a run: a number in four digits, any other text as it is."""
    try:
        return figure(float(text))
    except ValueError:
        return text


def file_size(size: int) -> str:
    """As "740 B", "3.4 MB"."""
    amount, unit = float(size), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if amount < 1000:
            break
        amount, unit = amount / 1000, larger
    return f"{amount:.3g} {unit}" if amount < 999.5 else f"{amount:.0f} {unit}"


def duration(seconds: float | None) -> str:
    """As "3.2 s", "4 min 10 s", "2 h 5 min"; "" where it is not known."""
    if seconds is None:
        return ""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours < 48 else f"{hours // 24} d {hours % 24} h"


def ago(iso: str | None) -> str:
    """How long ago a time was: "just now", "5 min ago", or its date; "" where it is not known."""
    try:
        then = datetime.fromisoformat(iso or "").astimezone(UTC)
    except ValueError:
        return ""
    seconds = (datetime.now(UTC) - then).total_seconds()
    if seconds < 45:
        return "just now"
    if seconds < 3600:
        return f"{max(1, round(seconds / 60))} min ago"
    if seconds < 86400:
        return f"{round(seconds / 3600)} h ago"
    return then.astimezone().strftime("%Y-%m-%d %H:%M")


def headline_metrics(metrics: Mapping[str, float | None]) -> list[tuple[str, float | None]]:
    """The first metrics of a run: a study names the main ones first."""
    return list(metrics.items())[:MAIN]
