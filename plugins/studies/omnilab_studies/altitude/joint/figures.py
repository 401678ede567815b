"""The figure of the study `joint`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Floats
from omnilab_studies.common.plots import COLORS, blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOM_M = 0.5  # shown above and below the true heights


def joint(rows: Sequence[Mapping[str, Any]], rises_m: tuple[Floats, Floats]) -> Figure:
    """Rates of right places against the height of the queries, and estimated against true height over the place."""
    figure = blank_figure(9.6, 4.0)
    left, right = figure.subplots(1, 2)
    offsets = [row["offset_m"] for row in rows]
    left.fill_between(
        offsets,
        [100 * row["nearest_low"] for row in rows],
        [100 * row["nearest_high"] for row in rows],
        color=COLORS["nearest"],
        alpha=0.2,
        linewidth=0,
    )
    left.plot(
        offsets, [100 * row["nearest_rate"] for row in rows], "o-", color=COLORS["nearest"], label="nearest place"
    )
    left.plot(offsets, [100 * row["within_step_rate"] for row in rows], "s--", color="#2563a8", label="within a step")
    left.set(ylim=(0, 103), xlabel="height above the map [m]", ylabel="queries [%]", title="Position")
    left.legend(frameon=False, fontsize=9)
    true, estimate = rises_m
    ends = [min(offsets), max(offsets)]
    right.plot(ends, ends, color="#8b93a1", linewidth=1)
    right.plot(true, estimate, ".", color="#2563a8", alpha=0.35, markersize=5)
    right.plot(offsets, [row["estimate_median_m"] for row in rows], "o-", color="#d1403f", markersize=5, label="median")
    low, high = ends[0] - ROOM_M, ends[1] + ROOM_M
    beyond = int(np.sum((estimate < low) | (estimate > high)))
    title = f"Height ({beyond} of {len(estimate)} beyond the frame)" if beyond else "Height"
    right.set(xlabel="height above the estimated place [m]", ylabel="estimate [m]", title=title, ylim=(low, high))
    right.legend(frameon=False, fontsize=9)
    for axes in (left, right):
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
