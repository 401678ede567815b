"""Viewer layout of the study `parameter_curves`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(parameters: Iterable[str], quantities: Sequence[str]) -> ViewLayout:
    """Images on the left, a plot for each quantity, one of the distance curves for each parameter, then the result."""
    images = (
        Panel("map", "Places and images", ("room", "places", "camera")),
        Panel("image", "Image", ("query/image",)),
        Panel("image", "Panorama", ("query/panorama",)),
    )
    against = tuple(Panel("plot", f"{name} (steps are values)", (f"against/{name}",)) for name in quantities)
    curves = [Panel("plot", f"{name} (steps are cm)", (f"curves/{name}",)) for name in parameters if "r2" in quantities]
    result = (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",)))
    return ViewLayout((images, against, *((tuple(curves),) if curves else ()), result))
