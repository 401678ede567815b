"""Viewer layout of localisation in a map."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", f"Places and queries: {VERDICT_COLORS}", ("room", "places", "camera", "estimate", "answers")),
            Panel("map", "Distance of the query to every place", ("distances",)),
        ),
        (
            Panel("image", "Query", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (
            Panel("plot", "Position error", ("error/position_m",)),
            Panel("plot", "Heading error", ("error/heading_deg",)),
            Panel("image", "Recall and precision", ("recall",)),
            Panel("text", "Result", ("summary",)),
        ),
    ),
    widths=(3, 2, 2),
)
