"""Figures of view filters (Gil et al., 2012, figures 6 to 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Floats
from omnilab_studies.common.plots import blank_figure as blank
from omnilab_studies.common.plots import style_of
from omnilab_studies.view_slam.consistency import ellipses
from omnilab_studies.view_slam.display import error_bands
from omnilab_studies.view_slam.drives import Drive
from omnilab_studies.view_slam.filter_runs import FilterEstimate
from omnilab_studies.view_slam.scenarios import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = "#8a94a6"
Rows = Sequence[Mapping[str, Any]]


def against_range(rows: Rows, names: Sequence[str]) -> Figure:
    """RMS position error of filters and odometry against the range, bands of two standard deviations (figure 6)."""
    grounds = list(dict.fromkeys(row["scenario"] for row in rows))
    figure = blank(5.2 * len(grounds), 4.0)
    for axes, ground in zip(figure.subplots(1, len(grounds), squeeze=False, sharey=True)[0], grounds, strict=True):
        own = [row for row in rows if row["scenario"] == ground]
        _errors(axes, own, "range_m", names)
        axes.set(title=f"{ground}, {own[0]['seeds']} drives", xlabel="range of observation [m]", ylabel="RMS error [m]")
    return figure


def against_count(rows: Rows, times: Rows, names: Sequence[str]) -> Figure:
    """RMS error against the number of views, time of a step against it, one against the other (figure 7)."""
    figure = blank(13.0, 4.0)
    error, cost, both = figure.subplots(1, 3)
    _errors(error, rows, "views", names)
    error.set(xlabel="views N", ylabel="RMS error [m]", title="Error", ylim=(0, None))
    for name, style in style_of(list(names)).items():
        own, timed = ([row for row in table if row["filter"] == name] for table in (rows, times))
        ms = [row["step_ms"] for row in timed]
        cost.plot([row["views"] for row in timed], ms, **style, label=name)
        both.plot(ms, [row["rms_m"] for row in own], **style, label=name)
        for row, one in zip(own, ms, strict=True):
            both.annotate(str(row["views"]), (one, row["rms_m"]), xytext=(3, 4), textcoords="offset points", fontsize=7)
    cost.set(xlabel="views N", ylabel="time of a step, median [ms]", title="Time", yscale="log", xscale="log")
    marks = sorted({row["views"] for row in times})
    cost.set_xticks(marks, [str(mark) for mark in marks])
    cost.minorticks_off()
    both.set(
        xlabel="time of a step, median [ms]", ylabel="RMS error [m]", title="Error against time, N beside", xscale="log"
    )
    for axes in (cost, both):
        _finish(axes)
    return figure


def consistency(rows: Rows, key: str, label: str, names: Sequence[str]) -> Figure:
    """NEES, averaged over seeds and steps, and the share of steps within the 95 % bounds, against what was varied."""
    grounds = list(dict.fromkeys(row["scenario"] for row in rows))
    figure = blank(5.2 * len(grounds), 6.0)
    panels = figure.subplots(2, len(grounds), squeeze=False)
    for (high, low), ground in zip(panels.T, grounds, strict=True):
        for name, style in style_of(list(names)).items():
            own = [row for row in rows if row["scenario"] == ground and row["filter"] == name]
            x = [row[key] for row in own]
            high.plot(x, [row["nees"] for row in own], **style, label=f"{name}, mean")
            high.plot(x, [row["nees_median"] for row in own], ":", color=style["color"], label=f"{name}, median")
            low.plot(x, [100 * row["nees_within"] for row in own], **style, label=name)
            high.axhspan(own[0]["nees_low"], own[0]["nees_high"], color=style["color"], alpha=0.12, linewidth=0)
        high.axhline(3, color=GREY, linewidth=1)
        high.set(title=ground, ylabel="NEES (3 expected, bands 95 %)", yscale="log")
        low.axhline(95, color=GREY, linewidth=1)
        low.set(xlabel=label, ylabel="steps within the bounds [%]", ylim=(0, 102))
        for axes in (high, low):
            _finish(axes)
    return figure


def drive(done: Drive, ground: Scenario, estimate: FilterEstimate, name: str, range_m: float) -> Figure:
    """A drive from above, views with ellipses of two standard deviations, and the errors with theirs (figures 8 to 10)."""
    figure = blank(11.5, 5.6)
    left, right = np.asarray(figure.subfigures(1, 2, width_ratios=(1.1, 1)))
    above = left.subplots()
    for wall in ground.walls_m:
        above.plot(*wall.T, color="#3b4250", linewidth=2)
    above.plot(*done.odometry[:, :2].T, "--", color="#e9a320", linewidth=1, label="odometry")
    above.plot(*done.truth[:, :2].T, ":", color="black", linewidth=1.4, label="truth")
    above.plot(*estimate.poses[:, :2].T, color="#2f6db3", linewidth=1.2, label=name)
    draw_views(above, estimate.views, estimate.view_covariances)
    above.set(
        xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{ground.name}, views observed within {range_m:g} m"
    )
    above.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)
    above.spines[["top", "right"]].set_visible(False)
    draw_errors(right.subplots(3, 1, sharex=True), *error_bands(estimate.poses, estimate.covariances, done.truth))
    return figure


def draw_views(axes: Axes, views: Floats, covariances: Floats) -> None:
    """Views (N, 3) as dots with the ellipses of their covariances (N, 3, 3)."""
    axes.plot(*views[:, :2].T, "o", color="#d1403f", markersize=3.5, label="views, 2σ")
    for outline in ellipses(views[:, :2], covariances[:, :2, :2]):
        axes.fill(*outline.T, facecolor="#d1403f", alpha=0.18, edgecolor="#d1403f", linewidth=0.8)


def draw_errors(panels: Any, error: Floats, sigma: Floats) -> None:
    """Errors (3, T) in x, y, heading over the steps, within two standard deviations (3, T)."""
    for axes, values, width, label in zip(panels, error, sigma, ("x [m]", "y [m]", "heading [°]"), strict=True):
        axes.fill_between(np.arange(len(values)), -2 * width, 2 * width, color="#2f6db3", alpha=0.18, linewidth=0)
        axes.plot(values, color="#2f6db3", linewidth=1)
        axes.axhline(0, color=GREY, linewidth=0.7)
        axes.set_ylabel(f"error in {label}")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_title("errors and ±2σ", fontsize=10)
    panels[-1].set_xlabel("step")


def _errors(axes: Axes, rows: Rows, key: str, names: Sequence[str]) -> None:
    """Mean error and band of each filter, and of odometry on as many drives as the first filter's."""
    for name, style in style_of(list(names)).items():
        own = [row for row in rows if row["filter"] == name]
        _band(axes, own, key, "rms_m", "rms_sigma_m", style, f"{name}, {own[0]['seeds']} drives")
    own = [row for row in rows if row["filter"] == names[0]]
    odometry = {"color": GREY, "linestyle": "--"}
    _band(axes, own, key, "odometry_rms_m", "odometry_sigma_m", odometry, "odometry")
    axes.set_ylim(0, None)
    _finish(axes)


def _band(axes: Axes, rows: Rows, key: str, mean: str, sigma: str, style: dict[str, Any], label: str) -> None:
    x, y, s = (np.array([row[name] for row in rows]) for name in (key, mean, sigma))
    axes.plot(x, y, **style, label=label)
    axes.fill_between(x, np.maximum(y - 2 * s, 0), y + 2 * s, color=style["color"], alpha=0.13, linewidth=0)


def _finish(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def maps(truth: Floats, odometry: Floats, estimates: Mapping[str, FilterEstimate]) -> dict[str, Figure]:
    """For each filter: the trajectories (T, 3) from above with views and ellipses, and errors with bands (figures 8 to 10)."""
    made = {}
    for name, one in estimates.items():
        figure = blank(12.5, 5.6)
        left, right = np.asarray(figure.subfigures(1, 2, width_ratios=(1.3, 1)))
        above = left.subplots()
        above.plot(*odometry[:, :2].T, "--", color="#e9a320", linewidth=1, label="odometry")
        above.plot(*truth[:, :2].T, color="#b9c2cf", linewidth=3, label="truth")
        above.plot(*one.poses[:, :2].T, color="#2f6db3", linewidth=1, label=name)
        draw_views(above, one.views, one.view_covariances)
        above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{len(one.views)} views")
        above.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)
        above.spines[["top", "right"]].set_visible(False)
        draw_errors(right.subplots(3, 1, sharex=True), *error_bands(one.poses, one.covariances, truth))
        made[name] = figure
    return made
