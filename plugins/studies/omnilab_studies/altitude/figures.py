"""Figures of the heights that altimeters estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes
from omnilab_studies.altitude.results import LEAST_M, AltitudeResults, HeightEstimates, by_height
from omnilab_studies.common.plots import CURVES, MARKERS, blank_figure, plain_axes, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RISING, FALLING = "#d1403f", "#2563a8"


def altitude_figures(results: AltitudeResults, times: Sequence[Mapping[str, Any]]) -> dict[str, Figure]:
    """Every figure that the estimates allow: `cases_NAME` only of altimeters with two curves."""
    drawn = {
        "estimates": estimates(results),
        "spread": spread(results),
        "signs": signs(results),
        "cost": cost(times),
    }
    two = [name for name in results.altimeters if len(_shown(results, name).heights.curves) == 2]
    return drawn | {f"cases_{name}": cases(_shown(results, name), results.references[-1]) for name in two}


def estimates(results: AltitudeResults) -> Figure:
    """Clear estimates against true heights: a line a column, and the median (thesis, figure 5.14)."""
    clear = results.levels[0].title
    names = results.altimeters
    figure = blank_figure(3.6 * len(names), 3.0 * len(results.references))
    grid = figure.subplots(len(results.references), len(names), squeeze=False, sharex=True)
    for row, reference in zip(grid, results.references, strict=True):
        for axes, name in zip(row, names, strict=True):
            parts = results.of(name, clear, reference)
            for one in parts:
                axes.plot(one.height_m, one.value, color="#8b93a1", linewidth=0.7, alpha=0.6)
            heights, middle = _median(parts)
            axes.plot(heights, middle, color="black", linewidth=1.0)
            axes.scatter(heights, middle, s=14, c=np.where(middle > 0, RISING, FALLING), zorder=3)
            axes.axhline(0, color="black", linewidth=0.6)
            axes.axvline(parts[0].height_m[np.abs(parts[0].rise_m).argmin()], color="black", linewidth=0.6, ls=":")
            axes.set_title(f"{name.replace('_', ' ')}, reference {reference}", fontsize=9)
            axes.set_ylabel(f"estimate [{parts[0].heights.unit}]", fontsize=8)
            plain_axes(axes)
    for axes in grid[-1]:
        axes.set_xlabel("height of the test [m]")
    figure.suptitle("Estimates of every column (grey), and their median: up (red), down (blue)", fontsize=10)
    return figure


def cases(estimates: HeightEstimates, reference: str) -> Figure:
    """Of one column: the least distances of both cases, their difference, and where they lie (thesis, figure 5.12)."""
    figure = blank_figure(10.5, 3.1)
    left, middle, right = figure.subplots(1, 3)
    least = {}
    for (name, curves), color in zip(estimates.heights.curves.items(), (FALLING, RISING), strict=True):
        label = name.replace("_", " ")
        least[name] = curves.min(axis=1)
        left.plot(estimates.height_m, least[name], "o-", color=color, markersize=3.5, label=label)
        right.plot(estimates.height_m, curves.argmin(axis=1), "o-", color=color, markersize=3.5, label=label)
    first, second = least.values()
    middle.plot(estimates.height_m, first - second, "o-", color="black", markersize=3.5)
    middle.axhline(0, color="black", linewidth=0.6)
    left.set(title="(a) least distance of each case", ylabel="distance")
    middle.set(title="(b) difference: its sign gives the case")
    right.set(title="(c) where it lies", ylabel=estimates.heights.unit)
    left.legend(fontsize=7, frameon=False)
    for axes in (left, middle, right):
        axes.set_xlabel(f"height of the test [m], reference {reference}")
        axes.title.set_fontsize(9)
        plain_axes(axes)
    return figure


def spread(results: AltitudeResults) -> Figure:
    """Mean and deviation over the columns of estimates over their largest, level by level (thesis, figures 5.17-5.20).

    A row a disturbance and reference, a column an altimeter; the bars of the levels stand beside one another.
    """
    disturbances = list(dict.fromkeys(level.disturbance for level in results.levels[1:])) or ["clear"]
    rows = [(disturbance, reference) for disturbance in disturbances for reference in results.references]
    names = results.altimeters
    figure = blank_figure(4.2 * len(names), 0.4 + 2.4 * len(rows))
    grid = figure.subplots(len(rows), len(names), squeeze=False, sharex=True, sharey=True)
    for row, (disturbance, reference) in zip(grid, rows, strict=True):
        levels = [results.levels[0], *(x for x in results.levels[1:] if x.disturbance == disturbance)]
        for axes, name in zip(row, names, strict=True):
            for k, level in enumerate(levels):
                heights, mean, deviation = by_height(results.of(name, level.title, reference))
                gap = float(np.diff(heights).min(initial=0.1))
                at = heights + 0.7 * gap * (k / max(1, len(levels) - 1) - 0.5)  # so that bars do not hide one another
                bars = {"elinewidth": 1.0, "capsize": 2.5, "fmt": f"{MARKERS[k % len(MARKERS)]}-", "ms": 4, "lw": 1.0}
                axes.errorbar(at, mean, deviation, color=CURVES[k], label=level.title.replace("_", " "), **bars)
            axes.axhline(0, color="black", linewidth=0.6)
            axes.set_title(f"{name.replace('_', ' ')}, reference {reference}", fontsize=10)
            plain_axes(axes)
        row[0].set_ylabel("estimate / its largest")
        row[-1].legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    for axes in grid[-1]:
        axes.set_xlabel("height of the test [m]")
    figure.suptitle("Mean and standard deviation over the columns", fontsize=10)
    return figure


def signs(results: AltitudeResults) -> Figure:
    """The rate of right signs against the size of the rise."""
    table = results.sign_table()
    rows = list(zip(*table.values(), strict=True))
    columns = min(3, len(results.levels))
    lines = -(-len(results.levels) // columns)
    figure = blank_figure(3.7 * columns, 2.8 * lines)
    grid = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    style = style_of(results.altimeters)
    for axes, level in zip(grid, results.levels, strict=False):
        for name in results.altimeters:
            points = [
                (rise, 100 * rate)
                for altimeter, title, rise, _, rate in rows
                if (altimeter, title) == (name, level.title)
            ]
            axes.plot(*zip(*points, strict=True), label=name.replace("_", " "), markersize=4, lw=1.3, **style[name])
        axes.axvline(LEAST_M, color="black", linewidth=0.6, ls=":")
        axes.set(ylim=(-3, 103), title=level.title.replace("_", " "))
        plain_axes(axes)
    for axes in grid[len(results.levels) :]:
        axes.set_axis_off()
    for i, axes in enumerate(grid[: len(results.levels)]):
        if i + columns >= len(results.levels):  # the lowest of its column
            axes.set_xlabel("|rise| [m]")
            axes.tick_params(labelbottom=True)
    for axes in grid[::columns]:
        axes.set_ylabel("right signs [%]")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def cost(times: Sequence[Mapping[str, Any]]) -> Figure:
    """Time of an estimate against the spread of clear estimates, for each reference (thesis, figure 5.13)."""
    figure = blank_figure(7.0, 4.2)
    axes = figure.subplots()
    references = list(dict.fromkeys(row["reference"] for row in times))
    style = style_of(list(dict.fromkeys(row["altimeter"] for row in times)))
    for row in times:
        first = row["reference"] == references[0]
        filled = {} if row["reference"] == references[-1] else {"markerfacecolor": "white"}
        label = row["altimeter"].replace("_", " ") if first else None
        axes.plot(
            row["estimate_ms"], row["spread"], ls="", markersize=9, label=label, **(style[row["altimeter"]] | filled)
        )
    axes.set(xlabel="ms an estimate", ylabel="spread of estimate / its largest", xlim=(0, None))
    axes.set_title(f"Time and spread, clear; filled: reference {references[-1]}", fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    plain_axes(axes)
    return figure


def curve_picture(estimates: HeightEstimates, i: int) -> Bytes:
    """One comparison's distances with their minima, (H, W, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.4, 2.5), dpi=110)
    axes = figure.add_axes((0.15, 0.18, 0.82, 0.7))
    for (name, curves), color in zip(estimates.heights.curves.items(), (FALLING, RISING, *CURVES), strict=False):
        least = int(curves[i].argmin())
        axes.plot(curves[i], color=color, linewidth=1.4, label=name.replace("_", " "))
        axes.plot(least, curves[i, least], "o", color=color)
    low, high = (f(c.min() if f is min else c.max() for c in estimates.heights.curves.values()) for f in (min, max))
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low) + 1e-9)
    axes.set_title(f"rise {estimates.rise_m[i]:+.2f} m: {estimates.value[i]:+.2f} {estimates.heights.unit}", fontsize=9)
    axes.set(xlabel="candidate", ylabel="distance")
    axes.legend(fontsize=7, frameon=False)
    plain_axes(axes)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _shown(results: AltitudeResults, name: str) -> HeightEstimates:
    return results.of(name, results.levels[0].title, results.references[-1])[0]


def _median(parts: Sequence[HeightEstimates]) -> tuple[Any, Any]:
    """Heights, and the median over the columns of the values there."""
    heights, values = (np.concatenate([getattr(part, name) for part in parts]) for name in ("height_m", "value"))
    known = np.isfinite(values)
    at = np.unique(heights[known].round(2))
    return at, np.array([np.median(values[known & (heights.round(2) == height)]) for height in at])
