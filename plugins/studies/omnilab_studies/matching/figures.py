"""Figures of the study `matching`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnilab_studies.common.plots import blank_figure, plain_axes, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def matching(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Matches that agree with the truth and errors of the direction against the distance, and the time of a pair."""
    figure = blank_figure(13.0, 4.0)
    count, error, cost = figure.subplots(1, 3, width_ratios=(3, 3, 2))
    names = list(dict.fromkeys(row["odometry"] for row in rows))
    for name, style in style_of(names).items():
        own = [row for row in rows if row["odometry"] == name]
        at = [row["distance_m"] for row in own]
        count.plot(at, [row["agreeing"] for row in own], **style, label=name)
        error.plot(at, [row["direction_error_median_deg"] for row in own], **style, label=name)
    for axes, title, unit in (
        (count, "Matches that agree with the truth", "matches of a pair, mean"),
        (error, "Direction of motion", "error, median [deg]"),
    ):
        axes.set(xlabel="distance of the images [m]", ylabel=unit, title=title)
        plain_axes(axes)
    count.set_ylim(0, None)
    error.set_ylim(0, None)
    count.legend(frameon=False)
    _draw_times(cost, rows, names)
    return figure


def _draw_times(axes: Any, rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> None:
    """Bars of the time to extract features from an image, and to relate two."""
    firsts = [next(row for row in rows if row["odometry"] == name) for name in names]
    extract, relate = ([row[key] for row in firsts] for key in ("extract_ms", "relate_ms"))
    axes.barh(names, extract, color="#2563a8", label="extract, an image")
    axes.barh(names, relate, left=extract, color="#e9a320", label="relate, a pair")
    axes.invert_yaxis()
    axes.set(xlabel="time, median [ms]", title="Time")
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    plain_axes(axes)
