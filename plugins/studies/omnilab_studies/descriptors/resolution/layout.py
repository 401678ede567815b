"""Viewer layout of the study `resolution`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout
from omnilab_studies.common.logs import VERDICT_COLORS

LAYOUT = ViewLayout(
    columns=(
        (Panel("map", f"First size: {VERDICT_COLORS}", ("room", "places", "answers")),),
        (
            Panel("image", "The first query's signature, a size a step", ("query/signature",)),
            Panel("plot", "Rate of nearest answers in each size", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)),),
    ),
    widths=(2, 2, 2),
)
