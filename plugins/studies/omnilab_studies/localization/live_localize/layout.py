"""Viewer layout of live localisation."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (
            Panel("map", f"Places and camera: {VERDICT_COLORS}", ("room", "places", "answer", "camera", "estimate")),
            Panel("map", "Distance of the image to every place", ("distances",)),
        ),
        (
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (
            Panel("plot", "Latency [ms]", ("time/latency_ms",)),
            Panel("plot", "Distance to the answered place", ("distance",)),
            Panel("plot", "Position error, where the truth is known", ("error/position_m",)),
            Panel("text", "Result", ("summary",)),
        ),
    ),
    widths=(3, 2, 2),
)
