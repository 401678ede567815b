"""Viewer layout of the study `robustness`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", f"First query: {VERDICT_COLORS}", ("room", "places", "camera", "estimate")),),
        (
            Panel("image", "The first query, a level a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each level", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Levels", ("log",))),
    ),
    widths=(2, 2, 2),
)
