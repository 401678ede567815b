"""Viewer layout of the study `trajectory`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel(
                "map",
                "The map grows (white dots: truth, green: loop closures)",
                ("room", "truth", "map", "closures", "robot"),
            ),
            Panel(
                "map", "By odometry alone (red), optimised (grey, loop closures green)", ("truth", "odometry", "final")
            ),
        ),
        (
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Matches, rotation undone (green: inliers)", ("query/panorama",)),
            Panel("plot", "ms for each image", ("time/image",)),
        ),
        (
            Panel("plot", "Position error after alignment", ("error",)),
            Panel("text", "Result", ("summary",)),
            Panel("log", "Log", ("log",)),
        ),
    ),
    widths=(3, 2, 2),
)
