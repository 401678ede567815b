"""Viewer layout of the study `render`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", "Where images are taken", ("room", "places", "camera")),),
        (Panel("image", "Image", ("image",)), Panel("image", "Panorama", ("panorama",))),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)
