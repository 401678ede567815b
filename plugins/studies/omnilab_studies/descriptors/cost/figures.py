"""Figures of the study `cost`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from omnilab_studies.common.plots import CURVES, blank_figure, plain_axes, plain_logarithmic

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bars(values: Mapping[str, Mapping[str, float]], label: str, title: str) -> Figure:
    """Horizontal bars for each name, one per kind of value, on a logarithmic axis."""
    kinds = list(dict.fromkeys(kind for of in values.values() for kind in of))
    figure = blank_figure(7.6, 1.2 + 0.22 * len(values) * (len(kinds) + 0.6))
    axes = figure.subplots()
    height = 0.8 / len(kinds)
    rows = np.arange(len(values))
    for k, kind in enumerate(kinds):
        widths = [of.get(kind, np.nan) for of in values.values()]
        drawn = axes.barh(
            rows + (k - (len(kinds) - 1) / 2) * height, widths, height, label=kind, color=CURVES[k % len(CURVES)]
        )
        axes.bar_label(drawn, [f"{width:.3g}" for width in widths], fontsize=7, padding=2)
    axes.set(yticks=rows, yticklabels=list(values), xlabel=label, title=title)
    axes.invert_yaxis()
    axes.margins(x=0.12, y=0.01)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=len(kinds), frameon=False)
    plain_axes(axes)
    plain_logarithmic(axes)
    return figure
