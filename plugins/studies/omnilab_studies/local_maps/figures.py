"""Figures of local maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import as_floor_plan, blank_figure, plain_logarithmic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnilab_studies.local_maps.results import FittedMap, LocalMapResult

TRUTH, ESTIMATE, QUERY = "#8b93a1", "#2563a8", "#d1403f"
COLORS = ["#2563a8", "#2a9d5c", "#e9a320", "#7d4fa3", "#17a2b0", "#8b5a2b"]


def local_map_figures(results: Sequence[LocalMapResult], maps: Sequence[FittedMap]) -> dict[str, Any]:
    """Error distributions for each localizer (thesis, figures 4.15, 4.16), times (figure 4.17), and the first queries' maps."""
    localizers = dict.fromkeys(r.case.localizer for r in results)
    drawn: dict[str, Any] = {
        f"errors_{name}": errors([r for r in results if r.case.localizer == name], name) for name in localizers
    }
    return {**drawn, "times": times(results), "maps": fitted(maps)}


def errors(results: Sequence[LocalMapResult], localizer: str) -> Figure:
    """A panel a method: boxes of the errors at each step, one per number of neighbours, beside the centroid's median."""
    names = list(dict.fromkeys(r.case.method for r in results))
    steps = list(dict.fromkeys(r.case.step_m for r in results))
    counts = list(dict.fromkeys(r.case.neighbours for r in results))
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = blank_figure(3.4 * columns, 2.9 * rows + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    wide = 0.8 / len(counts)
    for axes, name in zip(grid.ravel(), names, strict=False):
        for r in (r for r in results if r.case.method == name):
            k = counts.index(r.case.neighbours)
            at = steps.index(r.case.step_m) + (k - (len(counts) - 1) / 2) * wide
            _box(axes, r, at, wide, COLORS[k % len(COLORS)])
        axes.set_xticks(range(len(steps)), [f"{step_m:g} m" for step_m in steps])
        axes.set_title(name, fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", alpha=0.25)
    for axes in grid.ravel()[len(names) :]:
        axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set_ylabel("position error [m]")
    plain_logarithmic(grid[0, 0], "y")  # which the others share
    handles = [_patch(COLORS[k % len(COLORS)]) for k in range(len(counts))]
    labels = [f"{count} places" for count in counts]
    figure.legend(
        [*handles, _dash()], [*labels, "centroid, median"], loc="outside lower center", ncols=6, frameon=False
    )
    figure.suptitle(f"Local maps by {localizer}: boxes hold half of the errors, whiskers 90 %", fontsize=10)
    return figure


def _box(axes: Axes, result: LocalMapResult, at: float, wide: float, color: str) -> None:
    axes.boxplot(
        [result.error_m.ravel()], positions=[at], widths=0.8 * wide, whis=(5, 95), showfliers=False, patch_artist=True,
        manage_ticks=False, boxprops={"facecolor": color, "alpha": 0.6, "linewidth": 0}, medianprops={"color": "black"},
        whiskerprops={"color": color}, capprops={"color": color},
    )  # fmt: skip
    axes.plot(
        at + 0.45 * wide * np.array([-1, 1]), [np.median(result.centroid_m)] * 2, color=QUERY, linewidth=2, zorder=5
    )


def _patch(color: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=color, alpha=0.6)


def _dash() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=QUERY, linewidth=2)


def times(results: Sequence[LocalMapResult]) -> Figure:
    """Milliseconds a query against the number of neighbours and the size of the map (thesis, figure 4.17)."""
    figure = blank_figure(10, 4)
    left, right = figure.subplots(1, 2)
    localizers = list(dict.fromkeys(r.case.localizer for r in results))
    first, count = results[0].case.step_m, results[0].case.neighbours
    for k, name in enumerate(localizers):
        own = [r for r in results if r.case.localizer == name]
        _curve(
            left,
            {r.case.neighbours: _mean_embed_ms(own, r.case.neighbours, first) for r in own},
            f"a map, {name}",
            COLORS[k % len(COLORS)],
        )
        at = [r for r in own if r.case.neighbours == count]
        sizes = {r.places: float(np.mean([o.times.embed_ms for o in at if o.places == r.places])) for r in at}
        _curve(right, sizes, f"a map of {count} places, {name}", COLORS[k % len(COLORS)])
    _curve(right, {r.places: r.times.search_ms for r in results}, "the search of all places", QUERY)
    left.set(xlabel="places in the local map", title=f"Embedding, step {first:g} m")
    right.set(xlabel="places in the whole map", title="Search and embedding")
    for axes in (left, right):
        axes.set_ylabel("ms a query")
        plain_logarithmic(axes, "y")
        axes.legend(fontsize=8, frameon=False)
        axes.grid(alpha=0.25, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _mean_embed_ms(own: Sequence[LocalMapResult], neighbours: int, step_m: float) -> float:
    alike = [r for r in own if r.case.neighbours == neighbours and r.case.step_m == step_m]
    return float(np.mean([r.times.embed_ms for r in alike]))


def _curve(axes: Axes, points: Mapping[int, float], label: str, color: str) -> None:
    axes.plot(*zip(*sorted(points.items()), strict=True), "o-", label=label, color=color)


def fitted(maps: Sequence[FittedMap]) -> Figure:
    """Local maps over the truth, up to three a row: a line joins each place's true and estimated position (figure 4.7c)."""
    columns = min(3, len(maps)) if len(maps) != 4 else 2
    rows = -(-len(maps) // columns)
    figure = blank_figure(3.8 * columns, 3.9 * rows + 0.7)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(maps) :]:
        axes.set_axis_off()
    for axes, one in zip(grid.flat, maps, strict=False):
        _fitted(axes, one)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.suptitle("Maps of the first queries, fitted to the world on their places", fontsize=10)
    return figure


def _fitted(axes: Axes, one: FittedMap) -> None:
    moved = np.stack([one.truth_m, one.estimate_m, np.full_like(one.truth_m, np.nan)], axis=1).reshape(-1, 2)
    axes.plot(*moved.T, "-", color=TRUTH, linewidth=0.8, label="residuals")
    axes.plot(*one.truth_m[:-1].T, "o", color=TRUTH, markersize=5, label="places")
    axes.plot(*one.estimate_m[:-1].T, ".", color=ESTIMATE, markersize=6, label="their map")
    axes.plot(*one.truth_m[-1], "o", color=QUERY, markersize=7, markerfacecolor="none", label="query")
    axes.plot(*one.estimate_m[-1], "x", color=QUERY, markersize=7, markeredgewidth=2, label="its estimate")
    error_m = float(np.linalg.norm(one.truth_m[-1] - one.estimate_m[-1]))
    as_floor_plan(axes, f"error {error_m:.3f} m")
    axes.title.set_fontsize(9)
    axes.margins(0.12)
    axes.set_axisbelow(True)
    axes.grid(alpha=0.25)
