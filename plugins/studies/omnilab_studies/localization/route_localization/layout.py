"""Viewer layout of localisation along a route."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", f"Route and queries: {VERDICT_COLORS}", ("room", "places", "camera", "answers")),
            Panel("image", "Errors", ("errors",)),
        ),
        (
            Panel("image", "Query", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (
            Panel("plot", "Position error", ("error",)),
            Panel("plot", "Places in the set", ("set",)),
            Panel("text", "Result", ("summary",)),
        ),
    ),
    widths=(3, 2, 2),
)
