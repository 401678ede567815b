"""Charts as the coordinates that a template draws: no library, no script, and the same in pages and reports."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnilab_serve.words import figure

WIDTH, HEIGHT = 520.0, 300.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 14.0, 14.0, 46.0  # margins for labels
COLORS = 8  # of the style sheet; configurations of later numbers begin anew
LOGARITHMIC = 30.0  # ratio of the largest to the smallest value from which on an axis is logarithmic
MOST_TICKS = 12

Point = tuple[float, float]


@dataclass(frozen=True)
class ChartMark:
    """A point of a curve, in pixels, with its words."""

    x: float
    y: float
    words: str
    low: float | None = None  # ends of its interval, in pixels
    high: float | None = None


@dataclass(frozen=True)
class ChartCurve:
    """A curve of a chart, in one of its colours."""

    label: str
    color: int
    line: str  # an SVG path
    band: str = ""  # another, around the line
    marks: Sequence[ChartMark] = ()


@dataclass(frozen=True)
class AxisTick:
    """A place on an axis, in pixels, and its words."""

    at: float
    words: str


@dataclass(frozen=True)
class CurveChart:
    """A chart of curves over two axes."""

    title: str
    across: str  # what the axes are
    up: str
    curves: Sequence[ChartCurve]
    ticks_across: Sequence[AxisTick]
    ticks_up: Sequence[AxisTick]
    summary: str  # in words, for those who cannot see it
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM


class ChartAxis:
    """Values to pixels, linear or logarithmic."""

    def __init__(self, low: float, high: float, first: float, last: float, logarithmic: bool = False) -> None:
        self.logarithmic = logarithmic
        self._low, self._high = self._own(low), self._own(high)
        if self._low == self._high:
            self._low, self._high = self._low - 0.5, self._high + 0.5
        self._first, self._last = first, last

    def _own(self, value: float) -> float:
        return math.log10(value) if self.logarithmic else value

    def at(self, value: float) -> float:
        share = (self._own(value) - self._low) / (self._high - self._low)
        return round(self._first + share * (self._last - self._first), 2)

    def ticks(self) -> list[AxisTick]:
        """About five round values."""
        if self.logarithmic:
            values = [10.0**power for power in range(math.ceil(self._low), math.floor(self._high) + 1)]
        else:
            values = round_values(self._low, self._high)
        return [AxisTick(self.at(value), f"{value:g}") for value in values]


def round_values(low: float, high: float) -> list[float]:
    """About five round numbers within two bounds."""
    raw = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * nice for nice in (1, 2, 2.5, 5, 10) if power * nice >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def path_of(points: Iterable[Point]) -> str:
    return "M" + "L".join(f"{x:g},{y:g}" for x, y in points)


def across_axis(low: float, high: float, logarithmic: bool = False) -> ChartAxis:
    return ChartAxis(low, high, LEFT + 8, WIDTH - RIGHT - 8, logarithmic)


def up_axis(low: float, high: float) -> ChartAxis:
    return ChartAxis(low, high, HEIGHT - BOTTOM - 4, TOP + 4)


# ------------------------------------------------------------------------------------------- of whole comparisons
def error_charts(document: Mapping[str, Any]) -> list[CurveChart]:
    """Of each kind of errors, the share of the queries that stays within an error: a curve a configuration."""
    shares, curves = document["error_curves"]["shares"], document["error_curves"]["curves"]
    kinds = dict.fromkeys((curve["error"], curve["unit"]) for curve in curves)
    return [_error_chart(name, unit, [c for c in curves if c["error"] == name], shares) for name, unit in kinds]


def _error_chart(name: str, unit: str, found: Sequence[Mapping[str, Any]], shares: Sequence[float]) -> CurveChart:
    most = max(curve["quantiles"][-1] for curve in found)
    shown = min(most, 1.6 * max(curve["quantiles"][95] for curve in found)) or most or 1.0
    across, up = across_axis(0.0, shown), up_axis(0.0, 100.0)
    curves, words = [], []
    for curve in found:
        known = 1 - curve["missing"] / curve["queries"]  # whoever has no error is within none
        points = [(error, share * known) for error, share in zip(curve["quantiles"], shares, strict=True)]
        inside = [(across.at(x), up.at(y)) for x, y in _until(points, shown)]
        letter = curve["configuration"]
        curves.append(ChartCurve(letter, color_of(letter), path_of(inside)))
        words.append(f"{letter}: half within {figure(curve['quantiles'][50])} {unit}")
    title = name.removesuffix(f"_{unit}").replace("_", " ")
    axis = f"{title} [{unit}]"
    summary = f"Share of the queries whose {title} is at most a value. {'; '.join(words)}."
    return CurveChart(title, axis, "queries within [%]", curves, across.ticks(), up.ticks(), summary)


def _until(points: Sequence[Point], most: float) -> list[Point]:
    """A curve up to a value across; one that ends before goes on as it is."""
    if points[-1][0] <= most:
        return [*points, (most, points[-1][1])]
    inside = [point for point in points if point[0] <= most]
    (x0, y0), (x1, y1) = (inside or [(0.0, 0.0)])[-1], points[len(inside)]
    return [*inside, (most, y0 + (y1 - y0) * (most - x0) / (x1 - x0))]


def color_of(letter: str) -> int:
    """The colour of a configuration, the same in all charts and tables: A has the first."""
    number = 0
    for character in letter:
        number = number * 26 + ord(character) - ord("A") + 1
    return (number - 1) % COLORS


# ---------------------------------------------------------------------------------------- of a metric over settings
def metric_charts(document: Mapping[str, Any], metric: str) -> list[CurveChart]:
    """A metric over each setting that differs: a curve for each combination of the others, with intervals.

    Of settings that change together, such as a descriptor and its distance, the first stands for all.
    """
    rows = [row for row in document["configurations"] if _mean(row, metric) is not None]
    charts = []
    for setting, beside in independent_settings(rows, document["settings"]).items():
        if (chart := _metric_chart(document, rows, metric, setting, beside)) is not None:
            charts.append(chart)
    return charts


def independent_settings(rows: Sequence[Mapping[str, Any]], settings: Sequence[str]) -> dict[str, list[str]]:
    """Settings of which none tells another's value, and of each those of all that it does not tell."""
    columns = {name: [row["settings"][name] for row in rows] for name in settings}
    found: dict[str, list[str]] = {}
    for name in settings:
        if not any(_tells(columns[other], columns[name]) and _tells(columns[name], columns[other]) for other in found):
            found[name] = [other for other in settings if not _tells(columns[name], columns[other])]
    return found


def _tells(column: Sequence[Any], other: Sequence[Any]) -> bool:
    return len(set(zip(column, other, strict=True))) == len(set(column))


def _metric_chart(
    document: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], metric: str, setting: str, beside: Sequence[str]
) -> CurveChart | None:
    lines: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        lines.setdefault(_named(row, beside), []).append(row)
    values = sorted({row["settings"][setting] for row in rows}, key=value_order)
    if max(map(len, lines.values()), default=0) < 2 or len(values) < 2:
        return None
    numeric = all(value_order(value)[0] == 0 for value in values)
    places = {value: float(value) if numeric else float(i) for i, value in enumerate(values)}
    low, high = min(places.values()), max(places.values())
    air = 0.0 if numeric else 0.5  # beside categories, where curves stand beside one another
    across = across_axis(low - air, high + air, numeric and low > 0 and high / low > LOGARITHMIC)
    ends = [value for row in rows for value in _ends(row["metrics"][metric])]
    up = up_axis(*_around(min(ends), max(ends)))
    curves = [
        _setting_curve(label, i % COLORS, sorted(line, key=lambda row: places[row["settings"][setting]]),
                       metric, setting, (_moved(places, i, len(lines), numeric), across, up), numeric)
        for i, (label, line) in enumerate(lines.items())
    ]  # fmt: skip
    unit = next(found["unit"] for found in document["metrics"] if found["name"] == metric)
    shown = values[:: 1 + (len(values) - 1) // MOST_TICKS]
    ticks = [AxisTick(across.at(places[value]), short(value)) for value in shown]
    label = f"{metric} [{unit}]" if unit else metric
    summary = f"{metric} over {setting}, from {figure(min(ends))} to {figure(max(ends))}."
    return CurveChart(f"{metric} over {setting}", setting, label, curves, ticks, up.ticks(), summary)


def _moved(places: Mapping[Any, float], i: int, count: int, numeric: bool) -> Mapping[Any, float]:
    """Places of one of several curves over categories, where none lies on another."""
    return places if numeric else {value: at + 0.5 * ((i + 0.5) / count - 0.5) for value, at in places.items()}


def _setting_curve(
    label: str,
    color: int,
    rows: Sequence[Mapping[str, Any]],
    metric: str,
    setting: str,
    scales: tuple[Mapping[Any, float], ChartAxis, ChartAxis],
    joined: bool,
) -> ChartCurve:
    places, across, up = scales
    marks, band = [], list[tuple[float, float, float]]()
    for row in rows:
        found, x = row["metrics"][metric], across.at(places[row["settings"][setting]])
        words = f"{label + ', ' if label else ''}{setting}={row['settings'][setting]}: {found['text']}"
        known = found["low"] is not None
        low, high = (up.at(found["low"]), up.at(found["high"])) if known else (None, None)
        marks.append(ChartMark(x, up.at(found["mean"]), words, low, high))
        if low is not None and high is not None:
            band.append((x, low, high))
    line = path_of((mark.x, mark.y) for mark in marks) if joined and len(marks) > 1 else ""
    around = ""
    if line and len(band) == len(marks):
        around = path_of([(x, low) for x, low, _ in band] + [(x, high) for x, _, high in reversed(band)]) + "Z"
    return ChartCurve(label, color, line, around, marks)


def recall_chart(document: Mapping[str, Any]) -> CurveChart | None:
    """Recall at 1, 5, 10 places and so on, a curve a configuration; None where fewer than two are known."""
    prefix = "recall_at_"
    found = sorted(
        (int(rest), m["name"]) for m in document["metrics"]
        if (rest := m["name"].removeprefix(prefix)) != m["name"] and rest.isascii() and rest.isdecimal()
    )  # fmt: skip
    if len(found) < 2 or len(document["configurations"]) > COLORS:
        return None
    across, up = across_axis(0.0, len(found) - 1.0), up_axis(0.0, 1.0)
    curves, words = [], []
    for row in document["configurations"]:
        known = [(i, name, mean) for i, (_, name) in enumerate(found) if (mean := _mean(row, name)) is not None]
        marks = [
            ChartMark(across.at(i), up.at(mean), f"{row['name']}, {name}: {row['metrics'][name]['text']}")
            for i, name, mean in known
        ]
        if marks:
            curves.append(ChartCurve(row["name"], color_of(row["name"]), path_of((m.x, m.y) for m in marks), "", marks))
            words.append(f"{row['name']}: {figure(known[0][2])} at {found[known[0][0]][0]}")
    ticks = [AxisTick(across.at(i), str(count)) for i, (count, _) in enumerate(found)]
    summary = f"Recall among the nearest places. {'; '.join(words)}."
    return CurveChart("recall", "nearest places", "recall", curves, ticks, up.ticks(), summary) if curves else None


def _mean(row: Mapping[str, Any], metric: str) -> float | None:
    found = row["metrics"].get(metric)
    return found["mean"] if found else None


def _ends(found: Mapping[str, Any]) -> list[float]:
    return [value for value in (found["mean"], found["low"], found["high"]) if value is not None]


def _around(low: float, high: float) -> Point:
    """Bounds with some air; a share of one stays within 0 and 1."""
    air = 0.06 * (high - low) or 0.1 * abs(high) or 0.5
    if low >= 0 and high <= 1 and high - low > 0.3:
        return 0.0, 1.0
    return (0.0 if low >= 0 and low - air < 0 else low - air), high + air


def _named(row: Mapping[str, Any], settings: Sequence[str]) -> str:
    """Settings of a configuration in a line, by the last words of their names where these are clear."""
    last = [name.rpartition(".")[2] for name in settings]
    names = {name: word if last.count(word) == 1 else name for name, word in zip(settings, last, strict=True)}
    values = row["settings"]
    return ", ".join(f"{names[name]}={short(values[name])}" for name in settings if values[name] is not None)


def value_order(value: str | None) -> tuple[int, float, str]:
    """Numbers by their size, then texts, then what has no value."""
    try:
        number = float(value) if value is not None else math.nan
    except ValueError:
        number = math.nan
    return (0, number, "") if math.isfinite(number) else (2 if value is None else 1, 0.0, value or "")


def short(text: str | None, most: int = 18) -> str:
    """A text that fits beside a chart."""
    shown = "–" if text is None else text
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"
