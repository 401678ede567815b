"""Figures of view filters (Gil et al., 2012, figures 6 to 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Floats
from omnilab_studies.common.plots import as_floor_plan, plain_logarithmic, style_of
from omnilab_studies.common.plots import blank_figure as blank
from omnilab_studies.view_slam.consistency import ellipses
from omnilab_studies.view_slam.display import error_bands
from omnilab_studies.view_slam.drives import Drive
from omnilab_studies.view_slam.filter_runs import FilterEstimate
from omnilab_studies.view_slam.front_end import FilterClock
from omnilab_studies.view_slam.scenarios import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY, ODOMETRY, ESTIMATE, VIEW = "#8a94a6", "#e9a320", "#2f6db3", "#d1403f"
SEEN_SHARE = 0.02  # of the map's extent: half the length of an ellipse that can be seen
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
    cost.set(xlabel="views N", ylabel="time of a step, median [ms]", title="Time", xscale="log")
    marks = sorted({row["views"] for row in times})
    cost.set_xticks(marks, [str(mark) for mark in marks])
    cost.minorticks_off()
    both.set(xlabel="time of a step, median [ms]", ylabel="RMS error [m]", title="Error against time, N beside")
    for axes in (cost, both):
        _finish(axes)
    plain_logarithmic(cost, "y")
    plain_logarithmic(both)
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
        high.set(title=ground, ylabel="NEES (3 expected, bands 95 %)")
        low.axhline(95, color=GREY, linewidth=1)
        low.set(xlabel=label, ylabel="steps within the bounds [%]", ylim=(0, 102))
        for axes in (high, low):
            _finish(axes)
        plain_logarithmic(high, "y")
    return figure


def drive(done: Drive, ground: Scenario, estimate: FilterEstimate, name: str, range_m: float) -> Figure:
    """A drive from above, with walls, views and their ellipses, and the errors with their bands (figures 8 to 10)."""
    title = f"{ground.name}, views observed within {range_m:g} m"
    return _map_and_errors(done.truth, done.odometry, ground.walls_m, estimate, name, title)


def maps(
    truth: Floats, odometry: Floats, walls_m: Floats, estimates: Mapping[str, FilterEstimate]
) -> dict[str, Figure]:
    """For each filter: the trajectories (T, 3) from above among walls (W, 2, 2), and the errors (figures 8 to 10)."""
    return {
        name: _map_and_errors(truth, odometry, walls_m, one, name, f"{len(one.views)} {one.observes}")
        for name, one in estimates.items()
    }


def scenarios(drives: Mapping[str, tuple[Scenario, Drive]], range_m: float) -> Figure:
    """Scenarios from above: path, odometry, views at random, and the range about the robot half-way (figure 5)."""
    figure = blank(5.6 * len(drives), 5.6)
    for axes, (name, (ground, done)) in zip(
        figure.subplots(1, len(drives), squeeze=False)[0], drives.items(), strict=True
    ):
        _draw_walls(axes, ground.walls_m)
        axes.plot(*done.odometry[:, :2].T, ":", color=ODOMETRY, linewidth=1.3, label="odometry")
        axes.plot(*done.truth[:, :2].T, color="black", linewidth=1.2, label="truth")
        axes.plot(*done.truth[done.view_steps, :2].T, "o", color=VIEW, markersize=4.5, label="views")
        middle = len(ground.lap) // 2
        robot = done.truth[middle, :2]
        angle = np.linspace(0, 2 * np.pi, 181)
        circle = robot[:, None] + range_m * np.array([np.cos(angle), np.sin(angle)])
        axes.plot(*circle, "--", color=GREY, linewidth=1, label=f"range of observation, {range_m:g} m")
        axes.plot(*robot, "^", color=ESTIMATE, markersize=8, label="robot")
        seen = done.truth[done.view_steps[done.candidates(middle, range_m)], :2]
        axes.plot(*seen.T, "o", markerfacecolor="none", color=ESTIMATE, markersize=9, label="views it observes there")
        _as_map(axes, name)
    legend = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure


def _map_and_errors(
    truth: Floats, odometry: Floats, walls_m: Floats, estimate: FilterEstimate, name: str, title: str
) -> Figure:
    """Trajectories (T, 3), walls (W, 2, 2) and views from above; the errors of estimate and odometry beside them."""
    figure = blank(12.5, 5.8)
    figure.set_layout_engine("constrained", h_pad=0.1)  # or legends push titles off the subfigures
    left, right = np.asarray(figure.subfigures(1, 2, width_ratios=(1.2, 1)))
    above = left.subplots()
    _draw_walls(above, walls_m)
    above.plot(*odometry[:, :2].T, "--", color=ODOMETRY, linewidth=1, label="odometry")
    above.plot(*truth[:, :2].T, color="#b9c2cf", linewidth=3, label="truth")
    above.plot(*estimate.poses[:, :2].T, color=ESTIMATE, linewidth=1, label=name)
    draw_views(above, estimate)
    _as_map(above, title)
    left.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    panels = right.subplots(3, 1, sharex=True)
    draw_errors(panels, *error_bands(estimate.poses, estimate.covariances, truth), name)
    off, _ = error_bands(odometry, estimate.covariances, truth)
    for axes, values in zip(panels, off, strict=True):
        axes.plot(values, "--", color=ODOMETRY, linewidth=1, label="odometry")
    right.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def _draw_walls(axes: Axes, walls_m: Floats) -> None:
    """Walls (W, 2, 2), under what is drawn after them."""
    from matplotlib.collections import LineCollection

    if len(walls_m):
        axes.add_collection(LineCollection(list(walls_m), colors="#3b4250", linewidths=1.4, zorder=1, label="walls"))


def _as_map(axes: Axes, title: str) -> None:
    """A floor plan in metres."""
    as_floor_plan(axes, title)
    axes.spines[["top", "right"]].set_visible(False)


def draw_views(axes: Axes, estimate: FilterEstimate) -> None:
    """Views or landmarks as dots with the ellipses of their covariances, magnified by what the legend says.

    The map stays as large as it is, and ellipses that are longer have none drawn: a landmark may be anywhere on its ray.
    """
    views, covariances = estimate.views, estimate.view_covariances
    extent = max(axes.dataLim.width, axes.dataLim.height)
    factor = magnification(covariances, extent)
    label = f"{estimate.observes}, 2σ" if factor == 1 else f"{estimate.observes}, 2σ times {factor:g}"
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    axes.plot(*views[:, :2].T, "o", color=VIEW, markersize=2.5, label=label)
    short = 4 * factor * np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, 1]) < extent
    for outline in ellipses(views[short, :2], covariances[short, :2, :2], 2.0 * factor):
        axes.fill(*outline.T, facecolor=VIEW, alpha=0.18, edgecolor=VIEW, linewidth=0.8)


def magnification(covariances: Floats, extent_m: float) -> float:
    """The first of 1, 2, 5, 10, ... 1000 by which the median ellipse of covariances (N, 3, 3) can be seen on a map of an extent."""
    if len(covariances) == 0:
        return 1.0
    half = 2 * np.sqrt(np.median(np.linalg.eigvalsh(covariances[:, :2, :2])[:, 1]))
    factors = [base * 10.0**power for power in range(3) for base in (1, 2, 5)] + [1000.0]
    return next((factor for factor in factors if factor * half >= SEEN_SHARE * extent_m), 1000.0)


def draw_errors(panels: Any, error: Floats, sigma: Floats, name: str) -> None:
    """Errors (3, T) in x, y, heading over the steps, within two standard deviations (3, T)."""
    for axes, values, width, label in zip(panels, error, sigma, ("x [m]", "y [m]", "heading [°]"), strict=True):
        axes.fill_between(
            np.arange(len(values)), -2 * width, 2 * width, color=ESTIMATE, alpha=0.18, linewidth=0, label=f"{name}, ±2σ"
        )
        axes.plot(values, color=ESTIMATE, linewidth=1, label=name)
        axes.axhline(0, color=GREY, linewidth=0.7)
        axes.set_ylabel(f"error in {label}")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_title("errors", fontsize=10)
    panels[-1].set_xlabel("step")


def cost(clocks: Mapping[str, FilterClock]) -> Figure:
    """The variables that filters estimate, and the time that they take, image by image."""
    figure = blank(11.0, 4.0)
    state, taken = figure.subplots(1, 2)
    for name, style in style_of(list(clocks)).items():
        clock, plain = clocks[name], {"color": style["color"], "label": name}
        if clock.variables:
            state.plot(clock.variables, **plain)
        ms = 1e3 * np.array(clock.seconds)
        width = max(1, len(ms) // 50)
        starts = np.arange(0, len(ms), width)
        taken.plot(starts + width / 2, [np.median(ms[start : start + width]) for start in starts], **plain)
    state.set(xlabel="image", ylabel="variables", title="Variables that are estimated")
    taken.set(xlabel="image", ylabel="processor time of the filter [ms]", title="Time, without features")
    for axes in figure.axes:
        _finish(axes)
        plain_logarithmic(axes, "y")
    return figure


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
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
