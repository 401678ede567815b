"""Figures of topological maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import as_floor_plan, blank_figure
from omnilab_studies.local_maps.topological_map.results import best_of_each, grid_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnilab_studies.local_maps.topological_map.results import TopologicalMapResult

TRUTH = "#b6bcc6"
LINES = ("#2563a8", "#e9a320")  # along x and along y
MOST = 6  # maps on a sheet's row
WIDE, MARGIN = 3.6, 1.05  # inches of a map, and of the text above and below it


def topological_map_figures(maps: Sequence[TopologicalMapResult]) -> dict[str, Any]:
    """For each step, a sheet of all maps, and the best of every method (Payá et al., 2016, figures 12-14)."""
    sheets = {}
    for step_m in dict.fromkeys(one.case.step_m for one in maps):
        own = [one for one in maps if one.case.step_m == step_m]
        sheets[f"maps_{step_m:g}_m"] = _map_grid(own)
        sheets[f"best_{step_m:g}_m"] = _best(own)
    return sheets


def _map_grid(maps: Sequence[TopologicalMapResult]) -> Figure:
    """A row a method, a column an embedding: the map over the true grid, whose neighbours the lines join."""
    rows = list(dict.fromkeys(one.case.method for one in maps))
    columns = list(dict.fromkeys(one.case[2:] for one in maps))
    figure = _sheet(len(rows), len(columns), maps)
    grid = figure.subplots(len(rows), len(columns), squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for one in maps:
        axes = grid[rows.index(one.case.method), columns.index(one.case[2:])]
        axes.set_axis_on()
        _net(axes, one)
    return figure


def _best(maps: Sequence[TopologicalMapResult]) -> Figure:
    """The best map of each of the best methods, on one sheet."""
    best = sorted(best_of_each(maps), key=lambda one: one.rms_m)[:MOST]
    columns = min(3, len(best)) if len(best) != 4 else 2
    rows = -(-len(best) // columns)
    figure = _sheet(rows, columns, maps)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(best) :]:
        axes.set_axis_off()
    for axes, one in zip(grid.flat, best, strict=False):
        _net(axes, one)
    return figure


def _sheet(rows: int, columns: int, maps: Sequence[TopologicalMapResult]) -> Figure:
    span = np.ptp(maps[0].position_m[:, :2], axis=0)
    figure = blank_figure(WIDE * columns, rows * (WIDE * float(np.clip(span[1] / span[0], 0.4, 2)) + MARGIN) + 0.6)
    figure.suptitle(
        f"{maps[0].case.room or 'Maps'}, step {maps[0].case.step_m:g} m: maps (blue along x, yellow along y) over the true\n"
        "grid (grey), and the RMS of their residuals in steps",
        fontsize=10,
    )
    return figure


def _net(axes: Axes, one: TopologicalMapResult) -> None:
    """The true grid in grey, and the map's own, whose neighbours the lines join."""
    truth, estimate = one.position_m[:, :2], one.estimate_m
    lines = grid_edges(one.position_m, one.case.step_m)
    across = np.abs(np.diff(truth[lines], axis=1)[:, 0]).argmax(axis=1)
    axes.plot(*_strips(truth[lines]), "-", color=TRUTH, linewidth=0.7, zorder=0)
    axes.plot(*truth.T, "o", color=TRUTH, markersize=2, zorder=0)
    for axis, color in enumerate(LINES):
        axes.plot(*_strips(estimate[lines[across == axis]]), "-", color=color, linewidth=0.9)
    axes.plot(*estimate.T, ".", color="black", markersize=2.5)
    as_floor_plan(axes, f"{one.case.method}\n{one.embedding_title}: {one.rms_steps:.2f}")
    axes.title.set_fontsize(9)
    axes.tick_params(labelsize=8)


def _strips(ends: Any) -> Any:
    """Lines (E, 2, 2) as one curve (2, 3 E), with gaps between them."""
    return np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2).T
