"""Viewer layout of the study `joint`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (
            Panel(
                "map",
                f"First query at a height: {VERDICT_COLORS}",
                ("room", "places", "camera", "estimate"),
            ),
        ),
        (
            Panel("image", "Query, a height a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest places at each height", ("nearest",)),
            Panel("plot", "Height above the map: true, and estimated", ("height",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
