"""Viewer layout of the study `changes`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", "The map, and the answers in a condition", ("room", "places", "camera", "answers", "estimate")),),
        (
            Panel("image", "The first query, a condition a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers in each condition", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
