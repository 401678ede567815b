"""Figures of topological maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import blank_figure
from omnilab_studies.local_maps.topological_map.results import grid_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnilab_studies.local_maps.topological_map.results import TopologicalMapResult

TRUTH = "#8b93a1"
LINES = ("#2563a8", "#e9a320")  # along x and along y


def topological_map_figures(maps: Sequence[TopologicalMapResult]) -> dict[str, Any]:
    """A figure for each step (Payá et al., 2016, figures 12-14)."""
    steps = dict.fromkeys(one.case.step_m for one in maps)
    return {f"maps_{step_m:g}_m": _map_grid([one for one in maps if one.case.step_m == step_m]) for step_m in steps}


def _map_grid(maps: Sequence[TopologicalMapResult]) -> Figure:
    """A row a method, a column an embedding: the map over the true grid, whose neighbours the lines join."""
    rows = list(dict.fromkeys(one.case.method for one in maps))
    columns = list(dict.fromkeys(one.case[2:] for one in maps))
    span = np.ptp(maps[0].position_m[:, :2], axis=0)
    figure = blank_figure(3.0 * len(columns), len(rows) * (3.0 * float(span[1] / span[0]) + 0.75))
    grid = figure.subplots(len(rows), len(columns), squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for one in maps:
        axes = grid[rows.index(one.case.method), columns.index(one.case[2:])]
        _net(axes, one)
    figure.suptitle(
        f"Maps fitted to the grid, step {maps[0].case.step_m:g} m: RMS of the residuals in steps", fontsize=10
    )
    return figure


def _net(axes: Axes, one: TopologicalMapResult) -> None:
    truth, estimate = one.position_m[:, :2], one.estimate_m
    lines = grid_edges(one.position_m, one.case.step_m)
    across = np.abs(np.diff(truth[lines], axis=1)[:, 0]).argmax(axis=1)
    for axis, color in enumerate(LINES):
        ends = estimate[lines[across == axis]]
        strips = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axes.plot(*strips.T, "-", color=color, linewidth=0.8)
    axes.plot(*truth.T, ".", color=TRUTH, markersize=2, zorder=0)
    axes.set_aspect("equal")
    axes.set_title(f"{one.case.method}\n{one.embedding_title}: {one.rms_steps:.2f}", fontsize=8)
