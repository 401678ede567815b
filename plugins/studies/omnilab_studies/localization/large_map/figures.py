"""Figures of the study `large_map`: cost over the size of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import blank_figure
from omnilab_studies.localization.large_map.search_cost import exponent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COSTS = {
    "query_ms": "ms a query, one at a time",
    "compared": "signatures compared with a query",
    "index_mb": "MB of the prepared map, beside the signatures",
}
SHARES = {"agreement": "o-", "same": "s--", "recall": "^:"}


def scaling(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Costs against the number of places, with fitted power laws, and the agreement of the estimates."""
    figure = blank_figure(10.4, 8.4)
    panels = figure.subplots(2, 2).ravel()
    names = list(dict.fromkeys(row["localizer"] for row in rows))
    for i, name in enumerate(names):
        own = [row for row in rows if row["localizer"] == name]
        for axes, cost in zip(panels, COSTS, strict=False):
            _power_law(axes, name, [row["places"] for row in own], [row[cost] for row in own], f"C{i}")
        for share, style in SHARES.items():
            if i or share == "recall":  # the first is what the others are compared with
                label = f"{name}: {share}"
                panels[3].plot([r["places"] for r in own], [r[share] for r in own], style, color=f"C{i}", label=label)
    for axes, label in zip(panels, [*COSTS.values(), "share of the queries"], strict=True):
        axes.set(xscale="log", xlabel="places", ylabel=label)
        axes.grid(alpha=0.25, which="both")
        axes.spines[["top", "right"]].set_visible(False)
        if axes.get_legend_handles_labels()[0]:  # no cost of 0 has a line
            axes.legend(fontsize=8, frameon=False)
    panels[3].set_ylim(min(0.9, panels[3].get_ylim()[0]), 1.005)
    figure.suptitle("Cost and agreement as the map grows")
    return figure


def _power_law(axes: Axes, name: str, places: Sequence[float], costs: Sequence[float], color: str) -> None:
    """Measured points, and a line of the fitted slope through their middle; nothing where a cost is 0."""
    if min(costs) <= 0:
        return
    slope = exponent(places, costs)
    label = name if np.isnan(slope) else f"{name}: places$^{{{slope:.2f}}}$"
    axes.loglog(places, costs, "o", color=color, label=label)
    if not np.isnan(slope):
        middle = np.exp(np.mean(np.log(costs)) - slope * np.mean(np.log(places)))
        axes.loglog(places, middle * np.asarray(places, float) ** slope, "-", color=color, linewidth=1, alpha=0.7)
