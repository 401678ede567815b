"""Viewer layout of the study `local_map`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel(
                "map",
                "The local map settles over the truth (blue: compressed springs, red: stretched)",
                ("truth", "map"),
            ),
            Panel("map", "Places and query", ("room", "places", "camera")),
        ),
        (Panel("image", "Query", ("query/image",)), Panel("image", "Panorama", ("query/panorama",))),
        (
            Panel("plot", "Error of each query, map and centroid (steps are queries)", ("error/map", "error/centroid")),
            Panel("text", "Result", ("summary",)),
            Panel("log", "Log", ("log",)),
        ),
    ),
    widths=(3, 2, 3),
)
