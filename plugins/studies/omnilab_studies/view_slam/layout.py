"""Viewer layouts of the studies of view-based SLAM."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

VIEWS_TITLE = "Truth (grey), odometry (amber), estimated trajectory and views; bearings: believed (green), gated (red)"
VIEWS_SHOWN = ("truth", "odometry", "trajectory", "robot", "views", "candidates", "bearings")
VIEWS_ERRORS = (
    Panel("plot", "Error in x, ±2σ", ("error/x_m",)),
    Panel("plot", "Error in y, ±2σ", ("error/y_m",)),
    Panel("plot", "Error in heading, ±2σ", ("error/heading_deg",)),
)
VIEW_SLAM = ViewLayout(
    columns=(
        (
            Panel("map", VIEWS_TITLE, ("room", *VIEWS_SHOWN)),
            Panel("image", "Panorama above that of the view with most inliers", ("query/panorama",)),
        ),
        (Panel("image", "Image", ("query/image",)), *VIEWS_ERRORS),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(4, 2, 2),
)
VIEW_MAP = ViewLayout(
    columns=(
        (Panel("map", VIEWS_TITLE, ("walls", *VIEWS_SHOWN)),),
        VIEWS_ERRORS,
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(5, 2, 2),
)
