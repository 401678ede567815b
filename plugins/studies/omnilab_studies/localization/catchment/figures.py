"""Figures of catchment areas: difference functions, areas on the map, the compass over distance."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Floats, Ints
from omnilab_studies.common.plots import COLORS, as_floor_plan, blank_figure, plain_axes, style_of
from omnilab_studies.localization.catchment.results import Catchments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BINS = 16


def difference_curves(found: Sequence[Catchments]) -> Figure:
    """Difference over distance from the reference, the median of all references, as a share of its largest value."""
    figure = blank_figure(6.4, 4.0)
    axes = figure.subplots()
    styles = style_of([own.method for own in found])
    for own in found:
        at, middle = _binned(own.away_m, own.difference)
        axes.plot(
            at, middle / max(float(np.nanmax(middle)), 1e-12), ".-", color=styles[own.method]["color"], label=own.method
        )
    axes.set(xlabel="distance from the reference [m]", ylabel="image difference, of its largest", ylim=(0, 1.05))
    axes.set_title("Image difference functions")
    axes.legend(fontsize=7)
    plain_axes(axes)
    return figure


def compass_curves(found: Sequence[Catchments], limit_deg: float) -> Figure:
    """Error of the visual compass over distance: median, and nine of ten."""
    figure = blank_figure(6.4, 4.0)
    axes = figure.subplots()
    styles = style_of([own.method for own in found])
    for own in found:
        if own.off_deg is None:
            continue
        at, middle = _binned(own.away_m, np.abs(own.off_deg))
        _, most = _binned(own.away_m, np.abs(own.off_deg), 0.9)
        axes.plot(at, middle, ".-", color=styles[own.method]["color"], label=own.method)
        axes.plot(at, most, ":", color=styles[own.method]["color"], linewidth=1)
    axes.axhline(limit_deg, color="#8b93a1", linewidth=0.8)
    axes.set(
        xlabel="distance from the reference [m]", ylabel="heading error [deg]", title="Visual compass (dotted: 90 %)"
    )
    axes.legend(fontsize=7)
    plain_axes(axes)
    return figure


def areas(own: Catchments, position_m: Floats, references: Ints, unit: str) -> Figure:
    """The catchment of every reference, and the difference and catchment of one of them."""
    span = np.ptp(position_m[:, :2], axis=0)
    figure = blank_figure(11.0, 1.2 + 4.0 * min(1.2, max(0.5, span[1] / max(span[0], 1e-9))))
    left, right = figure.subplots(1, 2)
    left.plot(position_m[:, 0], position_m[:, 1], ".", color="#c9ced6", markersize=2, zorder=0)
    shown = left.scatter(*position_m[references, :2].T, c=own.size, s=28, cmap="viridis", zorder=1)
    figure.colorbar(shown, ax=left, label=f"catchment [{unit}]")
    as_floor_plan(left, f"{own.method}: catchment of each reference")
    r = int(np.argsort(own.size, kind="stable")[len(own.size) // 2])
    shown = right.scatter(position_m[:, 0], position_m[:, 1], c=own.difference[:, r], s=22, cmap="viridis_r")
    caught = position_m[own.caught[:, r]]
    right.plot(
        caught[:, 0], caught[:, 1], "o", markersize=7, markerfacecolor="none", color=COLORS["nearest"], label="caught"
    )
    right.plot(
        *position_m[references[r], :2], "x", markersize=10, color=COLORS["wrong"], markeredgewidth=2, label="reference"
    )
    figure.colorbar(shown, ax=right, label="image difference")
    as_floor_plan(right, "The median one (bright: alike)")
    right.legend(fontsize=7)
    return figure


def rotations(curves: Floats, away_m: Floats) -> Figure:
    """Rotational image difference functions (K, C), each from so far from the reference (K,), centred on its minimum."""
    figure = blank_figure(6.4, 4.0)
    axes = figure.subplots()
    turn = np.linspace(-180, 180, curves.shape[1], endpoint=False)
    for curve, away in zip(curves, away_m, strict=True):
        axes.plot(turn, np.roll(curve, len(curve) // 2 - int(curve.argmin())), label=f"{away:.2f} m")
    axes.set(
        xlabel="rotation from the best [deg]", ylabel="rms difference", title="Rotational image difference function"
    )
    axes.legend(fontsize=7, title="from the reference")
    plain_axes(axes)
    return figure


def _binned(away_m: Floats, values: Floats, share: float = 0.5) -> tuple[Floats, Floats]:
    """Distances (n,), and a quantile (n,) of the values at about these."""
    edges = np.linspace(0, float(away_m.max()) * 1.0001 or 1.0, BINS + 1)
    bins = [(away_m >= low) & (away_m < high) & np.isfinite(values) for low, high in pairwise(edges)]
    kept = [one for one in bins if one.any()]
    return np.array([away_m[one].mean() for one in kept]), np.array([np.quantile(values[one], share) for one in kept])
