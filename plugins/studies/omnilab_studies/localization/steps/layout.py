"""Viewer layout of the study `steps`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", "The map at each step, and the answers in it", ("room", "places", "camera", "answers")),),
        (
            Panel("image", "The last query, a step of the map at a time", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each step", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
