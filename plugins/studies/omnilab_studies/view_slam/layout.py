"""Viewer layouts of the studies of view-based SLAM."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

SHOWN = ("truth", "odometry", "trajectory", "robot", "views", "candidates", "bearings")
ESTIMATES = "estimated trajectory and views; bearings: believed (green), gated (red)"
TITLE = f"Truth (grey), odometry (amber), {ESTIMATES}"
ERRORS = (
    Panel("plot", "Error in x, ±2σ", ("error/x_m",)),
    Panel("plot", "Error in y, ±2σ", ("error/y_m",)),
    Panel("plot", "Error in heading, ±2σ", ("error/heading_deg",)),
)
RESULT = (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",)))


def _beside_images(world: Panel) -> ViewLayout:
    matches = Panel("image", "Panorama above that of the view with most inliers", ("query/panorama",))
    image = Panel("image", "Image", ("query/image",))
    return ViewLayout(columns=((world, matches), (image, *ERRORS), RESULT), widths=(4, 2, 2))


VIEW_SLAM = _beside_images(Panel("map", TITLE, ("room", *SHOWN)))
VIEW_DENSITY = _beside_images(
    Panel("map", f"Truth (grey), {ESTIMATES}", ("room", *(path for path in SHOWN if path != "odometry")))
)
VIEW_MAP = ViewLayout(columns=((Panel("map", TITLE, ("walls", *SHOWN)),), ERRORS, RESULT), widths=(5, 2, 2))
