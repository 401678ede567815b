"""Viewer layout of the study `large_map`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", "Places and queries (green: the exhaustive answer)", ("room", "places", "camera", "answers")),
            Panel("image", "The first query", ("query/image",)),
            Panel("image", "Its signature", ("query/signature",)),
        ),
        (
            Panel("plot", "ms a query, a map a step", ("time",)),
            Panel("plot", "Signatures compared with a query", ("compared",)),
            Panel("plot", "MB of the prepared map", ("memory",)),
            Panel("plot", "Agreement with exhaustive search", ("agreement",)),
        ),
        (Panel("text", "Result", ("summary",)),),
    ),
    widths=(2, 2, 2),
)
