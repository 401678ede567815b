"""Viewer layout of the study `lifelong_map`."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(policies: Sequence[str]) -> ViewLayout:
    """The answers of each policy, the day as the sensor sees it, and the curves over the days."""
    return ViewLayout(
        columns=(
            tuple(
                Panel("map", f"Answers of a day: {name}", ("room", "places", f"answers/{name}")) for name in policies
            ),
            (
                Panel("image", "The first query of a day", ("query/image",)),
                Panel("plot", "Rate of nearest answers of each day", ("nearest",)),
                Panel("plot", "Signatures at a wrong place", ("wrong_signatures",)),
                Panel("plot", "Signatures of the map", ("signatures",)),
            ),
            (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
        ),
        widths=(3, 2, 2),
    )
