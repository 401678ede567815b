"""Viewer layout of the study `matching`."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(odometries: Sequence[str]) -> ViewLayout:
    """The pairs in the world, each odometry's matches, and how many agree with the truth."""
    return ViewLayout(
        columns=(
            (
                Panel("map", "World and pairs of images", ("room", "images", "camera")),
                Panel("plot", "Matches of a pair that agree with the truth", ("agreeing",)),
            ),
            tuple(Panel("image", f"{name}: inliers of a pair", (f"matches/{name}",)) for name in odometries),
            (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
        ),
        widths=(2, 3, 2),
    )
