"""Viewer layout of comparisons of descriptors."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(curves: Sequence[str] = ()) -> ViewLayout:
    """Images on the left, then a panel for each of the named curves in up to two columns, then the result."""
    plots = [Panel("plot", f"{name} (steps are cm)", (f"curves/{name}",)) for name in curves]
    half = -(-len(plots) // 2)
    images = (
        Panel("map", "Places and images", ("room", "places", "camera")),
        Panel("image", "Image", ("query/image",)),
        Panel("image", "Panorama", ("query/panorama",)),
    )
    result = (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",)))
    columns = (images, *(tuple(part) for part in (plots[:half], plots[half:]) if part), result)
    return ViewLayout(columns)
