"""Viewer layout of the study `changes`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (
            Panel(
                "map", f"The map in a condition: {VERDICT_COLORS}", ("room", "places", "camera", "answers", "estimate")
            ),
        ),
        (
            Panel("image", "The first query, a condition a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers in each condition", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
