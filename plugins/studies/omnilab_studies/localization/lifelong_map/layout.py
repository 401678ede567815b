"""Viewer layout of the study `lifelong_map`."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS


def layout_of(policies: Sequence[str]) -> ViewLayout:
    """The answers of each policy in up to two columns, the day as the sensor sees it, and the curves over the days."""
    maps = [Panel("map", f"{name}: {VERDICT_COLORS}", ("room", "places", f"answers/{name}")) for name in policies]
    half = len(maps) if len(maps) < 3 else -(-len(maps) // 2)
    columns = [tuple(part) for part in (maps[:half], maps[half:]) if part]
    return ViewLayout(
        columns=(
            *columns,
            (
                Panel("image", "The first query of a day", ("query/image",)),
                Panel("plot", "Rate of nearest answers of each day", ("nearest",)),
                Panel("plot", "Signatures at a wrong place", ("wrong_signatures",)),
                Panel("plot", "Signatures of the map", ("signatures",)),
            ),
            (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
        ),
        widths=(*(3 for _ in columns), 2, 2),
    )
