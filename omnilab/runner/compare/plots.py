"""Pictures of a metric over settings and cost: curves, heat maps, parallel coordinates, a Pareto front."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.errors import visible
from omnilab.runner.compare.order import value_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d1f"]  # Okabe and Ito
MARKERS = "osD^vP*X"
MAP = "cividis"  # the same to all eyes
DPI = 150
MOST_CURVES, MOST_BANDS, MOST_CELLS, MOST_LABELS, MOST_TICKS = len(COLORS), 16, 120, 6, 12
LOGARITHMIC = 30.0  # from this ratio on
LONGEST = 48  # characters of a text


@dataclass(frozen=True)
class MetricCurve:
    """A curve: values at those of a setting, with the interval of each."""

    label: str
    at: Sequence[str | None]
    value: Floats
    low: Floats
    high: Floats
    over_seeds: Bools  # the others' intervals are those of single runs


class Scale:
    """Positions on an axis of a setting's values: numbers by their size, else one beside the other."""

    def __init__(self, values: Sequence[str | None]) -> None:
        self.texts = sorted(dict.fromkeys(values), key=value_order)
        self.numeric = all(value_order(text)[0] == 0 and math.isfinite(float(text or "")) for text in self.texts)
        places = [float(text or "") if self.numeric else i for i, text in enumerate(self.texts)]
        self._place = dict(zip(self.texts, places, strict=True))

    def of(self, values: Sequence[str | None]) -> Floats:
        return np.array([self._place[value] for value in values], float)

    @property
    def logarithmic(self) -> bool:
        places = list(self._place.values())
        return self.numeric and min(places) > 0 and max(places) / min(places) > LOGARITHMIC

    def show(self, axes: Axes) -> None:
        """Ticks across with the values as they are written, if they are few."""
        if self.logarithmic:
            axes.set_xscale("log")
        if not self.numeric or len(self.texts) <= MOST_TICKS:
            axes.set_xticks(list(self._place.values()), [plain(text, 20) for text in self.texts])
            axes.set_xticks([], minor=True)


def plain(text: str | None, longest: int = LONGEST) -> str:
    """A stranger's text as it is: no mathematics, no escapes, not longer than a picture is wide."""
    shown = visible("–" if text is None else text)
    shown = shown if len(shown) <= longest else f"{shown[: longest - 1]}…"
    return shown.replace("$", r"\$")


def curves(setting: str, metric: str, lines: Sequence[MetricCurve]) -> Figure:
    """A metric against one setting; a curve for each combination of the others, with a band over seeds."""
    figure, axes = _figure(7.0, 4.4)
    scale = Scale([value for line in lines for value in line.at])
    stroke, few = "-" if scale.numeric else ":", len(lines) <= MOST_BANDS
    bands = scale.numeric and all(line.over_seeds.all() for line in lines)
    for i, line in enumerate(lines):
        x, style = scale.of(line.at), _style(i, len(lines))
        axes.plot(x, line.value, stroke, label=plain(line.label), lw=1.8, ms=5, **style)
        if few and bands:
            axes.fill_between(x, line.low, line.high, color=style["color"], alpha=0.16, lw=0)
        elif few:
            bars = np.vstack([line.value - line.low, line.high - line.value]).clip(0)
            axes.errorbar(x, line.value, bars, fmt="none", ecolor=style["color"], alpha=0.55, lw=1.1, capsize=2.5)
    scale.show(axes)
    axes.set(xlabel=plain(setting), ylabel=plain(metric))
    axes.margins(x=0.05 if scale.numeric else 0.15)
    axes.set_title(_about_curves(lines, "bands" if bands else "bars", few), loc="left", fontsize=9, color="#444444")
    if 1 < len(lines) <= MOST_CURVES:
        figure.legend(loc="outside right upper", frameon=False, fontsize=8.5)
    return figure


def _about_curves(lines: Sequence[MetricCurve], shapes: str, few: bool) -> str:
    """What the curves are of, and their bands or bars."""
    over_seeds = np.concatenate([line.over_seeds for line in lines])
    of = "over seeds" if over_seeds.all() else "over seeds, or of the one run" if over_seeds.any() else "of the run"
    words = [f"{shapes}: 95 % interval {of}"] if few else []
    if len(lines) > MOST_CURVES:
        words.append(f"{len(lines)} curves, dark: {plain(lines[0].label)}, to light: {plain(lines[-1].label)}")
    return "\n".join(words)


def heat_maps(across: str, down: str, metric: str, panels: Mapping[str, Mapping[tuple[Any, Any], float]]) -> Figure:
    """A metric over two settings; a panel for each combination of the others."""
    columns = Scale([x for panel in panels.values() for x, _ in panel]).texts
    rows = Scale([y for panel in panels.values() for _, y in panel]).texts[::-1]
    size = (min(1.6 + 0.62 * len(columns), 9.0), min(1.3 + 0.42 * len(rows), 7.0))
    figure, first = _figure(size[0] * len(panels) + 1.3, size[1] + 0.5, len(panels))
    grids = [np.array([[panel.get((x, y), np.nan) for x in columns] for y in rows]) for panel in panels.values()]
    known = np.concatenate([grid[np.isfinite(grid)] for grid in grids]) if grids else np.zeros(0)
    low, high = (known.min(), known.max()) if len(known) else (0.0, 1.0)
    for axes, title, grid in zip(np.atleast_1d(first), panels, grids, strict=True):
        image = axes.imshow(grid, cmap=MAP, vmin=low, vmax=high, aspect="auto")
        for set_ticks, values in (axes.set_xticks, columns), (axes.set_yticks, rows):
            shown = range(0, len(values), 1 + (len(values) - 1) // MOST_TICKS)
            set_ticks(list(shown), [plain(values[i], 14) for i in shown])
        axes.set(xlabel=plain(across), ylabel=plain(down))
        axes.set_title(plain(title), fontsize=9)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        if grid.size <= MOST_CELLS:
            _numbers(axes, grid, (low + high) / 2)
    figure.colorbar(image, ax=first, label=plain(metric), shrink=0.9)
    return figure


def _numbers(axes: Axes, grid: Floats, middle: float) -> None:
    """The value in each cell, dark on light and light on dark."""
    for (i, j), value in np.ndenumerate(grid):
        color = "#444444" if math.isnan(value) else "white" if value < middle else "black"
        axes.text(j, i, "–" if math.isnan(value) else f"{value:.3g}", ha="center", va="center", fontsize=8, color=color)


def parallel_coordinates(settings: Mapping[str, Sequence[str | None]], metric: str, values: Floats) -> Figure:
    """A line for each configuration through its settings and its metric, which colours it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    figure, axes = _figure(2.2 + 1.7 * len(settings), 4.6)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    norm = Normalize(low, high)
    height = []
    for i, column in enumerate(settings.values()):
        scale = Scale(column)
        at = np.array([scale.texts.index(value) for value in column]) / max(1, len(scale.texts) - 1)
        height.append(at)
        axes.plot([i, i], [0, 1], color="#777777", lw=1)
        shown = range(len(scale.texts)) if len(scale.texts) <= MOST_TICKS else (0, len(scale.texts) - 1)
        for k in shown:
            y = k / max(1, len(scale.texts) - 1)
            axes.annotate(
                plain(scale.texts[k], 16),
                (i, y),
                (-5, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                fontsize=8,
                bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 0.8},
                zorder=5,
            )
    last = (values - low) / ((high - low) or 1)
    points = np.stack([*height, last], axis=1)
    order = np.argsort(values)[np.isfinite(np.sort(values))]
    lines = [np.column_stack([np.arange(points.shape[1]), points[i]]) for i in order]
    axes.add_collection(LineCollection(lines, colors=_colors(norm, values[order]), lw=1.5, alpha=0.75, zorder=3))
    axes.set(xlim=(-0.45, len(settings)), ylim=(-0.04, 1.04), yticks=[])
    axes.set_xticks(range(len(settings)), [plain(name, 26) for name in settings])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    figure.colorbar(ScalarMappable(norm, MAP), ax=axes, label=plain(metric), pad=0.0, aspect=26)
    return figure


def _colors(norm: Any, values: Floats) -> Any:
    from matplotlib import colormaps

    return colormaps[MAP](norm(values))


def pareto(cost: str, metric: str, points: tuple[Floats, Floats], labels: Sequence[str], sign: int) -> Figure:
    """A metric against what it costs; the front of those that nothing beats in both. `sign`: -1 where more is better, 0: not known."""
    x, y = points
    figure, axes = _figure(6.6, 4.4)
    axes.scatter(x, y, s=26, color="#9a9a9a", lw=0, alpha=0.8, zorder=2)
    if sign:
        front = on_front(x, sign * y)
        front = front[np.argsort(x[front])]
        axes.step(x[front], y[front], where="post", color=COLORS[0], lw=1.5, zorder=3)
        axes.scatter(x[front], y[front], s=42, color=COLORS[0], zorder=4)
        for i in _apart(x, y, front):
            left = x[i] < np.median([x.min(), x.max()])
            place = {"xytext": (7, -3), "ha": "left"} if left else {"xytext": (-7, 3), "ha": "right"}
            text = axes.annotate(plain(labels[i]), (x[i], y[i]), textcoords="offset points", fontsize=8,
                                 va="top" if left else "bottom", **place)  # fmt: skip
            text.set_in_layout(False)  # else the axes make room for it
    if len(x) and x.min() > 0 and x.max() / x.min() > LOGARITHMIC:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.margins(x=0.12, y=0.12)
    better = {1: "less is better", -1: "more is better", 0: "--best METRIC or -METRIC draws the front"}[sign]
    axes.set(xlabel=plain(cost), ylabel=plain(metric))
    axes.set_title(f"Pareto front ({better})" if sign else better, loc="left", fontsize=9, color="#444444")
    return figure


def _apart(x: Floats, y: Floats, front: Any) -> list[int]:
    """Points of a front whose labels do not lie on one another: first its ends, then those between."""
    chosen: list[int] = []
    for i in [*front[[-1, 0]], *front[1:-1]]:
        near = [j for j in chosen if abs(x[i] - x[j]) < 0.5 * np.ptp(x) and abs(y[i] - y[j]) < 0.08 * np.ptp(y)]
        if not near and i not in chosen and len(chosen) < MOST_LABELS:
            chosen.append(i)
    return chosen


def on_front(cost: Floats, value: Floats) -> Any:
    """Indices of points (N,) that no other is as good as in both and better in one; small is good."""
    order = np.lexsort((value, cost))
    best, front = np.inf, []
    for i in order:
        if value[i] < best:
            front.append(i)
            best = value[i]
    return np.array(front, int)


def _style(i: int, count: int) -> dict[str, Any]:
    """Colour and marker of a curve; of many, colours in the order of the curves."""
    if count <= MOST_CURVES:
        return {"color": COLORS[i], "marker": MARKERS[i]}
    from matplotlib import colormaps

    return {"color": colormaps[MAP](i / (count - 1)), "alpha": 0.7}


def _figure(width: float, height: float, panels: int = 1) -> tuple[Figure, Any]:
    """A figure with plain axes and a faint grid."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    axes = figure.subplots(1, panels)
    for one in np.atleast_1d(axes):
        one.spines[["top", "right"]].set_visible(False)
        one.grid(alpha=0.25)
        one.set_axisbelow(True)
    return figure, axes
