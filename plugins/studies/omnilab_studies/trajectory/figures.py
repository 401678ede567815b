"""Figures of trajectories and loop closures (Berenguer, thesis, figures 6.6 and 6.7)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab_studies.common.plots import blank_figure as blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUTH, RIGHT, WRONG = "#b9c2cf", "#2a9d5c", "#d1403f"
LINES = ("#2f6db3", "#e9a320", "#8e44ad", "#17807e")
HIGH = 1.3  # of a panel's height, over its width


def paths(panels: Mapping[str, Floats], truth: Floats | None, closures: Ints, right: Bools | None, unit: str) -> Figure:
    """Trajectories by odometry alone, online and optimised, positions (N, 2) each, over the true one (N, 2).

    Loop closures (L, 2) are drawn in the last panels: green the right ones, red the wrong ones.
    """
    extent = np.ptp(next(iter(panels.values())) if truth is None else truth, axis=0)
    ratio = float(np.clip(extent[1] / max(extent[0], 1e-9), 0.45, HIGH))
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = blank(4.8 * columns, rows * (4.3 * ratio + 0.8))
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for number, (axes, (name, positions)) in enumerate(zip(grid, panels.items(), strict=False)):
        if truth is not None:
            axes.plot(*truth.T, color=TRUTH, linewidth=4, zorder=0, label="truth")
        if number:
            _closures(axes, positions, closures, right)
        axes.plot(*positions.T, color=LINES[min(number, 1)], linewidth=1.1, label=name, zorder=2)
        axes.plot(*positions[0], "o", color="black", markersize=4, zorder=3)
        axes.set(aspect="equal", adjustable="datalim", xlabel=f"x [{unit}]", ylabel=f"y [{unit}]", title=name)
        axes.legend(fontsize=7, frameon=False, loc="best")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _closures(axes: Axes, positions: Floats, closures: Ints, right: Bools | None) -> None:
    from matplotlib.collections import LineCollection

    good = np.ones(len(closures), bool) if right is None else right
    for which, color, label in ((good, RIGHT, "loop closures"), (~good, WRONG, "wrong loop closures")):
        if which.any():
            lines = LineCollection(
                list(positions[closures[which]]), colors=color, linewidths=1.0, zorder=1, label=label
            )
            axes.add_collection(lines)
            axes.plot(*positions[closures[which, 1]].T, ".", color=color, markersize=3, zorder=1)


def errors(along_m: Floats, errors_m: Mapping[str, Floats]) -> Figure:
    """Position errors (N,) of each trajectory, in metres, along the true path (N,)."""
    figure = blank(7.2, 3.2)
    axes = figure.subplots()
    for (name, values), color in zip(errors_m.items(), LINES * len(errors_m), strict=False):
        axes.plot(along_m, values, color=color, linewidth=1.2, label=name)
    axes.set(xlabel="true path [m]", ylabel="position error [m]", ylim=(0, None), title="After alignment")
    axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def times(times_ms: Floats) -> Figure:
    """Time of each image (N,), over the images in the map, and the running median of fifty."""
    figure = blank(7.2, 3.2)
    axes = figure.subplots()
    axes.plot(times_ms, ".", color=LINES[0], markersize=2.5, alpha=0.4)
    window = min(50, len(times_ms))
    medians = np.median(np.lib.stride_tricks.sliding_window_view(times_ms, window), axis=1)
    axes.plot(np.arange(len(medians)) + window - 1, medians, color=LINES[0], label=f"median of {window}")
    axes.set(
        xlabel="images in the map", ylabel="time for one more [ms]", ylim=(0, float(np.quantile(times_ms, 0.99)) * 1.3)
    )
    axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
