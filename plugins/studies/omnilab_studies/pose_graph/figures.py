"""Figures of pose graphs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes, Floats, Ints, PoseGraph
from omnilab.posegraph.graph import edge_chi2, is_loop
from omnilab_studies.common.plots import blank_figure, style_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PATH = (108, 122, 143)
RAMP = np.array([[42, 157, 92], [233, 163, 32], [209, 64, 63]], float)  # fits, doubtful, wrong
WORST = 6.0  # standard deviations at which the ramp ends
HIGH = 1.3  # of a panel's height, over its width


def deviations(graph: PoseGraph, poses: Floats) -> Floats:
    """By how many standard deviations each edge is off, (E,): the root of its chi2 over its degrees of freedom."""
    return np.asarray(np.sqrt(edge_chi2(graph, poses) / graph.information.shape[1]))


def colors(graph: PoseGraph, poses: Floats) -> Bytes:
    """An RGB colour (E, 3) for each edge: grey along the path; loop closures green, amber, red by how far they are off."""
    share = np.clip(deviations(graph, poses) / WORST, 0, 1)
    ramp = np.column_stack([np.interp(share, [0, 0.5, 1], channel) for channel in RAMP.T])
    return np.where(is_loop(graph)[:, None], ramp, PATH).astype(np.uint8)


def graphs(graph: PoseGraph, panels: Mapping[str, Floats], truth: Floats | None, wrong: Ints) -> Figure:
    """The graph with one set of poses (N, k) after the other, seen from above; loop closures by how far they are off.

    Wrong ones are thin.
    """
    columns = min(3, len(panels)) if len(panels) != 4 else 2
    rows = -(-len(panels) // columns)
    spans = [np.ptp(poses[:, :2], axis=0) for poses in panels.values()]
    ratio = np.clip(np.median([span[1] / max(span[0], 1e-9) for span in spans]), 0.5, HIGH)
    figure = blank_figure(4.6 * columns, rows * (4.3 * ratio + 0.7) + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for axes, (name, poses) in zip(grid, panels.items(), strict=False):
        _draw(axes, graph, poses, truth, wrong)
        axes.set_title(name.replace("_", " "), fontsize=10)
    _ramp(figure, grid[: len(panels)])
    return figure


def _draw(axes: Axes, graph: PoseGraph, poses: Floats, truth: Floats | None, wrong: Ints) -> None:
    from matplotlib.collections import LineCollection

    paint, loops = colors(graph, poses) / 255, is_loop(graph)
    off = deviations(graph, poses)
    if truth is not None:
        axes.plot(*truth[:, :2].T, color="#b9c2cf", linewidth=2.5, zorder=0, label="truth")
        axes.legend(fontsize=7, frameon=False, loc="upper right")
    order = np.argsort(np.where(loops, off, -1))  # the worst on top
    is_wrong = np.isin(order, wrong)
    widths: Floats = np.where(loops[order], np.where(is_wrong, 0.35, 0.8), 0.8)
    lines = poses[graph.edges[order], :2]
    axes.add_collection(LineCollection(list(lines), colors=list(paint[order]), linewidths=widths.tolist(), zorder=1))
    shown = poses if truth is None else np.concatenate([poses, truth])
    axes.set_xlim(*_limits(shown[:, 0]))
    axes.set_ylim(*_limits(shown[:, 1]))
    axes.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]")
    axes.spines[["top", "right"]].set_visible(False)


def _limits(values: Floats) -> tuple[float, float]:
    margin = 0.05 * float(np.ptp(values)) + 0.1
    return float(values.min()) - margin, float(values.max()) + margin


def _ramp(figure: Figure, panels: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    cmap = LinearSegmentedColormap.from_list("fit", list(RAMP / 255))
    bar = figure.colorbar(ScalarMappable(Normalize(0, WORST), cmap), ax=list(panels), shrink=0.7, extend="max")
    bar.set_label("loop closures are off by [standard deviations]", fontsize=8)


def growth(times_ms: Mapping[str, Floats]) -> Figure:
    """How long each pose took to add, and the running mean of a hundred."""
    figure = blank_figure(7.2, 3.4)
    axes = figure.subplots()
    for (name, values), style in zip(times_ms.items(), style_of(list(times_ms)).values(), strict=True):
        axes.plot(values, ".", color=style["color"], markersize=2, alpha=0.35)
        window = np.ones(min(100, len(values))) / min(100, len(values))
        mean = np.convolve(values, window, mode="valid")
        axes.plot(np.arange(len(mean)) + len(window) - 1, mean, color=style["color"], label=name.replace("_", " "))
    axes.set(xlabel="poses in the map", ylabel="time to add one [ms]", yscale="log", title="As the map grows")
    axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
