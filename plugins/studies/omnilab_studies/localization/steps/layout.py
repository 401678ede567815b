"""Viewer layout of the study `steps`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", f"The map at each step: {VERDICT_COLORS}", ("room", "places", "camera", "answers")),),
        (
            Panel("image", "The last query, a step of the map at a time", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each step", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
