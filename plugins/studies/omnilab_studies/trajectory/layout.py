"""How the study `trajectory` looks in a viewer."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", "The map grows (white dots: the true way)", ("room", "truth", "map", "closures", "robot")),
            Panel("map", "By odometry alone, and optimised", ("truth", "odometry", "final")),
        ),
        (
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Where matches moved to (green: they agree with the motion)", ("query/panorama",)),
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
