"""Viewer layout of the study `altitude`."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(altimeters: Sequence[str], described: bool) -> ViewLayout:
    """A column of images as it rises, the distances that altimeters compare, and the heights they estimate."""
    pictures = [Panel("image", "The image, a height a step", ("query/image",))]
    if described:
        pictures.append(Panel("image", "Its transform: the offsets run down", ("query/signature",)))
    curves = [Panel("image", f"{name}: distances", (f"curves/{name}",)) for name in altimeters]
    heights = Panel("plot", "Rise over the last reference: estimates, scaled, and truth", ("rise",))
    columns = (
        (Panel("map", "The columns", ("room", "places", "camera")), *pictures),
        (heights, *curves),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    )
    return ViewLayout(columns, widths=(3, 3, 2))
