"""Viewer layout of the study `rotations`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", "The pair: axes of both cameras", ("room", "places", "reference_camera", "camera")),
            Panel("plot", "Error of the rotation, a pair a step", ("error",)),
        ),
        (
            Panel("image", "Reference", ("reference",)),
            Panel("image", "Query", ("query",)),
            Panel("image", "Query, its rotation undone by the first method", ("undone",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(2, 3, 2),
)
