"""Viewer layout of the study `topological_map`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", "Each map settles over the truth (blue: compressed springs, red: stretched)", ("truth", "map")),),
        (
            Panel("map", "Where the images are taken", ("room", "truth", "camera")),
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Maps", ("log",))),
    ),
    widths=(3, 2, 2),
)
