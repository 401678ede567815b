"""Viewer layout of catchment areas."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", "Places", ("room", "places")),
            Panel("map", "Difference of every place from the reference", ("distances",)),
        ),
        (Panel("image", "Catchments", ("areas",)), Panel("image", "Difference functions", ("differences",))),
        (Panel("plot", "Catchment of each reference", ("catchment",)), Panel("text", "Result", ("summary",))),
    ),
    widths=(2, 3, 2),
)
