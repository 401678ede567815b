"""Viewer layout of the study `map`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", "The map", ("room", "places", "camera")),),
        (
            Panel("image", "Place", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
