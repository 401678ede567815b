"""Figures of localisation along a route: answers with error whiskers, cumulative errors, sets of places, the compass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Floats
from omnilab_studies.common.plots import COLORS, as_floor_plan, blank_figure, plain_axes, style_of
from omnilab_studies.localization.route_localization.ambiguity import PlaceSets
from omnilab_studies.localization.route_localization.drives import RouteDrive
from omnilab_studies.localization.route_localization.results import Compass, RouteErrors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 10  # curves of one figure


def drawn(
    errors: Sequence[RouteErrors], sets: Mapping[str, PlaceSets], compasses: Sequence[Compass], places_m: Floats, queries: RouteDrive
) -> dict[str, Figure]:  # fmt: skip
    """All figures."""
    found = {"route": route(errors, places_m, queries), "errors": cumulative(errors), "sets": place_sets(sets, queries)}
    return found | ({"compass": compass(compasses)} if compasses else {})


def route(errors: Sequence[RouteErrors], places_m: Floats, queries: RouteDrive) -> Figure:
    """The route with a whisker from each query to its answer, by the method with the least median error; a panel a localizer."""
    best = min(errors, key=lambda own: own.median_m).method
    shown = [own for own in errors if own.method == best]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    span = np.ptp(places_m[:, :2], axis=0)
    figure = blank_figure(5.2 * columns, rows * (0.9 + 4.4 * min(1.2, max(0.1, span[1] / max(span[0], 1e-9)))))
    panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    for axes, own in zip(panels, shown, strict=False):
        _whiskers(axes, own, places_m, queries.position_m)
        axes.label_outer()
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    panels[0].legend(fontsize=7, loc="best")
    figure.suptitle(f"{best}: from each query (dot) to its answer")
    return figure


def _whiskers(axes: Axes, own: RouteErrors, places_m: Floats, truth_m: Floats) -> None:
    axes.plot(places_m[:, 0], places_m[:, 1], "-", color="#c9ced6", linewidth=1, zorder=0)
    axes.plot(places_m[:, 0], places_m[:, 1], "|", color="#8b93a1", markersize=5, label="places", zorder=1)
    lines = np.stack([truth_m[:, :2], own.answer_m[:, :2], np.full((len(truth_m), 2), np.nan)], 1).reshape(-1, 2)
    axes.plot(lines[:, 0], lines[:, 1], "-", color=COLORS["wrong"], linewidth=0.8, zorder=2)
    axes.plot(truth_m[:, 0], truth_m[:, 1], ".", color="#2563a8", markersize=3, label="queries", zorder=3)
    as_floor_plan(axes, f"{own.localizer}: median {own.median_m:.3f} m")


def cumulative(errors: Sequence[RouteErrors]) -> Figure:
    """Cumulative error curves: the localizers by the best method, and the methods by the best localizer."""
    best = min(errors, key=lambda own: own.median_m)
    figure = blank_figure(9.6, 4.0)
    left, right = figure.subplots(1, 2, sharey=True)
    _curves(
        left,
        {own.localizer: own.error_m for own in errors if own.method == best.method},
        f"{best.method}, by localizer",
    )
    by_method = sorted((own for own in errors if own.localizer == best.localizer), key=lambda own: own.median_m)
    _curves(right, {own.method: own.error_m for own in by_method[:MOST]}, f"{best.localizer}, by method")
    left.set_ylabel("queries [%]")
    return figure


def _curves(axes: Axes, values: Mapping[str, Floats], title: str) -> None:
    styles = style_of(list(values))
    for name, errors in values.items():
        ranked = np.sort(errors[np.isfinite(errors)])
        share = 100 * np.arange(1, len(ranked) + 1) / max(len(ranked), 1)
        axes.step(ranked, share, where="post", color=styles[name]["color"], label=name)
    reach = max(
        (float(np.nanquantile(errors, 0.97)) for errors in values.values() if np.isfinite(errors).any()), default=1.0
    )
    floor = min(
        (float(np.nanquantile(errors, 0.9)) for errors in values.values() if np.isfinite(errors).any()), default=1.0
    )
    axes.set(xlabel="position error [m]", title=title, xlim=(0, min(reach, 4 * floor) or 1.0), ylim=(0, 102))
    axes.legend(fontsize=7, loc="lower right")
    plain_axes(axes)


def place_sets(sets: Mapping[str, PlaceSets], queries: RouteDrive) -> Figure:
    """How far the places of each query's set reach, over the queries; crosses where it speaks of places elsewhere."""
    shown = dict(sorted(sets.items(), key=lambda item: float(np.median(item[1].size)))[: MOST // 2])
    figure = blank_figure(8.4, 1.2 + 1.3 * len(shown))
    panels = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True))
    step = np.arange(len(queries))
    for axes, (name, own) in zip(panels, shown.items(), strict=True):
        axes.plot(step, own.extent_m, "-", color="#2563a8", linewidth=1)
        axes.plot(step[own.ambiguous], own.extent_m[own.ambiguous], "x", color=COLORS["wrong"], markersize=4)
        axes.set_title(
            f"{name}: {np.median(own.size):.0f} places, {100 * own.ambiguous.mean():.0f} % ambiguous (x)", fontsize=9
        )
        axes.set_ylabel("reach [m]")
        plain_axes(axes)
    panels[-1].set_xlabel("query")
    return figure


def compass(compasses: Sequence[Compass]) -> Figure:
    """Deviation of the visual compass from the known heading, along the drive."""
    ranked = sorted(compasses, key=lambda own: float(np.nanmedian(np.abs(own.deviation_deg))) if np.isfinite(own.deviation_deg).any() else np.inf)[:MOST]  # fmt: skip
    figure = blank_figure(8.4, 3.6)
    axes = figure.subplots()
    styles = style_of([own.method for own in ranked])
    for own in ranked:
        axes.plot(_parted(own.deviation_deg), "-", linewidth=1, color=styles[own.method]["color"], label=own.method)
    axes.set(xlabel="image of the drive", ylabel="heading by images - known heading [deg]", title="Visual compass")
    axes.legend(fontsize=7, ncols=2)
    plain_axes(axes)
    return figure


def _parted(deviation_deg: Floats) -> Floats:
    """Angles with a gap wherever one step leads over half a turn: no line runs down the figure from 180 to -180."""
    over = np.abs(np.diff(deviation_deg, prepend=deviation_deg[:1])) > 180
    return np.where(over, np.nan, deviation_deg)
