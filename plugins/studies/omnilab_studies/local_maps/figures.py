"""Figures of local and topological maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import blank_figure
from omnilab_studies.local_maps.embedders import FittedMap
from omnilab_studies.local_maps.topological_map.results import grid_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnilab_studies.local_maps.results import Trial
    from omnilab_studies.local_maps.topological_map.results import WholeMap

TRUTH, FOUND, QUERY = "#8b93a1", "#2563a8", "#d1403f"
COLORS = ["#2563a8", "#2a9d5c", "#e9a320", "#7d4fa3", "#17a2b0", "#8b5a2b"]


def local_maps(trials: Sequence[Trial], maps: Sequence[FittedMap]) -> dict[str, Any]:
    """Error distributions for each localizer (thesis, figures 4.15, 4.16), times (4.17), and the first queries' maps."""
    makers = dict.fromkeys(t.case.localizer for t in trials)
    drawn: dict[str, Any] = {
        f"errors_{name}": errors([t for t in trials if t.case.localizer == name], name) for name in makers
    }
    return {**drawn, "times": times(trials), "maps": fitted(maps)}


def errors(trials: Sequence[Trial], localizer: str) -> Figure:
    """A panel a method: boxes of the errors at each step, one per number of neighbours, beside the centroid's median."""
    names = list(dict.fromkeys(t.case.method for t in trials))
    steps = list(dict.fromkeys(t.case.step_m for t in trials))
    counts = list(dict.fromkeys(t.case.neighbours for t in trials))
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = blank_figure(3.4 * columns, 2.9 * rows + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    wide = 0.8 / len(counts)
    for axes, name in zip(grid.ravel(), names, strict=False):
        for t in (t for t in trials if t.case.method == name):
            k = counts.index(t.case.neighbours)
            at = steps.index(t.case.step_m) + (k - (len(counts) - 1) / 2) * wide
            _box(axes, t, at, wide, COLORS[k % len(COLORS)])
        axes.set_xticks(range(len(steps)), [f"{step_m:g} m" for step_m in steps])
        axes.set_title(name, fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", alpha=0.25)
    for axes in grid.ravel()[len(names) :]:
        axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set(ylabel="position error [m]", yscale="log")
    handles = [_patch(COLORS[k % len(COLORS)]) for k in range(len(counts))]
    labels = [f"{count} places" for count in counts]
    figure.legend(
        [*handles, _dash()], [*labels, "centroid, median"], loc="outside lower center", ncols=6, frameon=False
    )
    figure.suptitle(f"Local maps by {localizer}: boxes hold half of the errors, whiskers 90 %", fontsize=10)
    return figure


def _box(axes: Axes, trial: Trial, at: float, wide: float, color: str) -> None:
    axes.boxplot(
        [trial.error_m.ravel()], positions=[at], widths=0.8 * wide, whis=(5, 95), showfliers=False, patch_artist=True,
        manage_ticks=False, boxprops={"facecolor": color, "alpha": 0.6, "linewidth": 0}, medianprops={"color": "black"},
        whiskerprops={"color": color}, capprops={"color": color},
    )  # fmt: skip
    axes.plot(
        at + 0.45 * wide * np.array([-1, 1]), [np.median(trial.centroid_m)] * 2, color=QUERY, linewidth=2, zorder=5
    )


def _patch(color: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=color, alpha=0.6)


def _dash() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=QUERY, linewidth=2)


def times(trials: Sequence[Trial]) -> Figure:
    """Milliseconds a query against the number of neighbours and the size of the map (thesis, figure 4.17)."""
    figure = blank_figure(10, 4)
    left, right = figure.subplots(1, 2)
    makers = list(dict.fromkeys(t.case.localizer for t in trials))
    first, count = trials[0].case.step_m, trials[0].case.neighbours
    for k, name in enumerate(makers):
        own = [t for t in trials if t.case.localizer == name]
        _curve(
            left,
            {t.case.neighbours: _of(own, "neighbours", t, first) for t in own},
            f"a map, {name}",
            COLORS[k % len(COLORS)],
        )
        at = [t for t in own if t.case.neighbours == count]
        sizes = {t.places: float(np.mean([o.times.arrange_ms for o in at if o.places == t.places])) for t in at}
        _curve(right, sizes, f"a map of {count} places, {name}", COLORS[k % len(COLORS)])
    _curve(right, {t.places: t.times.search_ms for t in trials}, "the search of all places", QUERY)
    left.set(xlabel="places in the local map", title=f"Arranging, step {first:g} m")
    right.set(xlabel="places in the whole map", title="Searching and arranging")
    for axes in (left, right):
        axes.set(ylabel="ms a query", yscale="log")
        axes.legend(fontsize=8, frameon=False)
        axes.grid(alpha=0.25, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _of(own: Sequence[Trial], field: str, like: Trial, step_m: float) -> float:
    alike = [t for t in own if getattr(t.case, field) == getattr(like.case, field) and t.case.step_m == step_m]
    return float(np.mean([t.times.arrange_ms for t in alike]))


def _curve(axes: Axes, points: Mapping[int, float], label: str, color: str) -> None:
    axes.plot(*zip(*sorted(points.items()), strict=True), "o-", label=label, color=color)


def fitted(maps: Sequence[FittedMap]) -> Figure:
    """Local maps over the truth: a line joins where each place is and where its map has it, red for the query."""
    figure = blank_figure(3.2 * len(maps), 3.4)
    for axes, one in zip(figure.subplots(1, len(maps), squeeze=False)[0], maps, strict=True):
        for truth, found in zip(one.truth_m, one.found_m, strict=True):
            axes.plot(*np.stack([truth, found], 1), "-", color=TRUTH, linewidth=0.8)
        axes.plot(*one.truth_m[:-1].T, "o", color=TRUTH, markersize=5)
        axes.plot(*one.found_m[:-1].T, ".", color=FOUND, markersize=6)
        axes.plot(*one.truth_m[-1], "o", color=QUERY, markersize=7, markerfacecolor="none")
        axes.plot(*one.found_m[-1], "x", color=QUERY, markersize=7, markeredgewidth=2)
        error_m = float(np.linalg.norm(one.truth_m[-1] - one.found_m[-1]))
        axes.set_aspect("equal")
        axes.margins(0.12)
        axes.set_title(f"error {error_m:.3f} m", fontsize=9)
    figure.suptitle("Places (grey) and their map (blue); the query (red): o truth, x answer", fontsize=10)
    return figure


def whole_maps(maps: Sequence[WholeMap]) -> dict[str, Any]:
    """A figure for each step (Payá et al., 2016, figures 12-14)."""
    steps = dict.fromkeys(one.case.step_m for one in maps)
    return {f"maps_{step_m:g}_m": drawn_maps([one for one in maps if one.case.step_m == step_m]) for step_m in steps}


def drawn_maps(maps: Sequence[WholeMap]) -> Figure:
    """A row a method, a column a way: the map over the true grid, whose neighbours the lines join."""
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


def _net(axes: Axes, one: WholeMap) -> None:
    truth, found = one.position_m[:, :2], one.found_m
    lines = grid_edges(one.position_m, one.case.step_m)
    across = np.abs(np.diff(truth[lines], axis=1)[:, 0]).argmax(axis=1)
    for axis, color in enumerate((FOUND, "#e9a320")):
        ends = found[lines[across == axis]]
        strips = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axes.plot(*strips.T, "-", color=color, linewidth=0.8)
    axes.plot(*truth.T, ".", color=TRUTH, markersize=2, zorder=0)
    axes.set_aspect("equal")
    axes.set_title(f"{one.case.method}\n{one.way}: {one.rms_steps:.2f}", fontsize=8)
