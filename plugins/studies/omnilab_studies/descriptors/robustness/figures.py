"""Figures of the study `robustness`: rates over the levels, sharpness, distance surfaces, cost against accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_studies.common.plots import blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnilab_studies.common.disturbance_levels import Level
    from omnilab_studies.common.method_runs import MethodCost


def pictures(shown: Sequence[Bytes], levels: Sequence[Level]) -> Figure:
    """The first query, clear and at every level; a row a disturbance."""
    rows = _by_disturbance(levels)
    columns = 1 + max(len(steps) for steps in rows.values())
    height, width = shown[0].shape[:2]
    figure = blank_figure(2.0 * columns, (2.0 * height / width + 0.25) * len(rows))
    grid = figure.subplots(len(rows), columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for row, steps in zip(grid, rows.values(), strict=True):
        for axes, step in zip(row, [0, *steps], strict=False):
            axes.imshow(shown[step], cmap="gray", vmin=0, vmax=255)
            axes.set_title(levels[step].title.replace("_", " "), fontsize=9)
    return figure


def rates(found: Mapping[str, Floats], levels: Sequence[Level], queries: int) -> Figure:
    """The rate of nearest estimates against each disturbance (thesis, figure 4.23)."""
    rows = _by_disturbance(levels)
    columns = min(3, len(rows))
    lines = -(-len(rows) // columns)
    figure = blank_figure(4.0 * columns + 1.6, 3.1 * lines)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True).ravel()
    style = style_of(list(found))
    for axes, (name, steps) in zip(grid, rows.items(), strict=False):
        for method, values in found.items():
            axes.plot(100 * values[[0, *steps]], label=method, linewidth=1.8, markersize=6, **style[method])
        ticks = ["clear", *(_value(levels[i]) for i in steps)]
        axes.set_xticks(range(len(ticks)), ticks)
        axes.set(ylim=(0, 103), title=name.replace("_", " "), xlabel=levels[steps[0]].setting.replace("_", " "))
        plain_axes(axes)
    for axes in grid[len(rows) :]:
        axes.set_axis_off()
    for axes in grid[::columns]:
        axes.set_ylabel("nearest [%]")
    figure.legend(
        *grid[0].get_legend_handles_labels(), loc="outside right center", title=f"{queries} queries", frameon=False
    )
    return figure


def sharpness(found: Mapping[str, Floats]) -> Figure:
    """Sharpness C of every clear query (Q,), by method: a dot each, and the mean (thesis, eq. 4.6)."""
    figure = blank_figure(6.4, 1.1 + 0.55 * len(found))
    axes = figure.subplots()
    style = style_of(list(found))
    for y, (name, values) in enumerate(found.items()):
        spread = 0.18 * np.sin(np.arange(len(values)) * 2.4)  # so that dots do not hide one another
        axes.plot(100 * values, y + spread, ".", color=style[name]["color"], alpha=0.35, markersize=4)
        axes.plot(100 * values.mean(), y, "|", color="black", markersize=22, markeredgewidth=2)
        axes.text(103, y, f"{100 * values.mean():.0f} %", va="center")
    axes.set_yticks(range(len(found)), list(found))
    axes.invert_yaxis()
    axes.set(xlim=(0, 102), xlabel="C = (mean - min) / (max - min) of a query's distances [%]", title="Sharpness")
    plain_axes(axes)
    return figure


def surfaces(places_m: Floats, fields: Mapping[str, Floats], truth_m: Floats) -> Figure:
    """Distance surfaces of the first clear query, each method on its own scale (thesis, figure 4.24)."""
    columns = min(len(fields), 5)
    rows = -(-len(fields) // columns)
    figure = blank_figure(2.6 * columns, 2.9 * rows)
    x, y = (np.unique(places_m[:, axis].round(6)) for axis in (0, 1))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(fields) :]:
        axes.set_axis_off()
    for axes, (name, field) in zip(panels, fields.items(), strict=False):
        mesh = np.full((len(y), len(x)), np.nan)  # places that are not free stay blank
        mesh[np.searchsorted(y, places_m[:, 1].round(6)), np.searchsorted(x, places_m[:, 0].round(6))] = field
        axes.pcolormesh(x, y, mesh, cmap="viridis_r", shading="nearest")
        axes.plot(*truth_m[:2], "o", markersize=9, markerfacecolor="none", markeredgecolor="white", markeredgewidth=3)
        axes.plot(*truth_m[:2], "o", markersize=9, markerfacecolor="none", markeredgecolor="black")
        axes.plot(*places_m[field.argmin(), :2], "x", color="#d1403f", markersize=8, markeredgewidth=2)
        axes.set(aspect="equal", title=name, xlabel="x [m]")
        axes.title.set_fontsize(10)
    figure.supylabel("y [m]", fontsize=10)
    figure.suptitle("Distances to the places (bright: alike); o where the query is, x the nearest", fontsize=10)
    return figure


def pareto(costs: Mapping[str, MethodCost], accuracy: Mapping[str, float], title: str) -> Figure:
    """Cost against accuracy: bytes of a place, and time of a query; the line joins the Pareto front."""
    figure = blank_figure(9.6, 4.2)
    left, right = figure.subplots(1, 2, sharey=True)
    _front(left, {name: cost.bytes_per_place / 1024 for name, cost in costs.items()}, accuracy)
    _front(right, {name: cost.query_ms for name, cost in costs.items()}, accuracy)
    left.set(xlabel="KiB a place", ylabel="nearest [%]")
    right.set(xlabel="ms a query: describe and localise")
    right.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.suptitle(title[0].upper() + title[1:], fontsize=11)
    return figure


def _front(axes: Axes, cost: Mapping[str, float], accuracy: Mapping[str, float]) -> None:
    for name, style in style_of(list(cost)).items():
        axes.plot(cost[name], 100 * accuracy[name], linestyle="", markersize=9, label=name, zorder=2, **style)
    best = [
        name for name in cost
        if not any(cost[o] <= cost[name] and accuracy[o] >= accuracy[name] and o != name for o in cost)
    ]  # fmt: skip
    front = sorted((cost[name], 100 * accuracy[name]) for name in best)
    axes.plot(*zip(*front, strict=True), color="#8b93a1", linewidth=1.2, drawstyle="steps-post", zorder=1)
    axes.margins(0.08, 0.08)
    plain_logarithmic(axes)
    plain_axes(axes)


def _value(level: Level) -> str:
    return f"{level.value:g}" if isinstance(level.value, float | int) else level.value


def _by_disturbance(levels: Sequence[Level]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for step, level in enumerate(levels[1:], 1):
        found.setdefault(level.disturbance, []).append(step)
    return found
