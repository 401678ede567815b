"""Cost against accuracy of descriptors: the Pareto front."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from omnilab_studies.common.plots import blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRONT, DOT = "#d1403f", "#2f6db3"


def pareto(points: Mapping[str, tuple[float, float]], cost: str, gain: str, title: str) -> Figure:
    """Cost (logarithmic) against gain; a line joins the Pareto front."""
    figure = blank_figure(7.6, 5.2)
    axes = figure.subplots()
    front = pareto_front(points)
    best = sorted(points[name] for name in front)
    axes.step(*zip(*best, strict=True), where="post", color=FRONT, linewidth=1, alpha=0.6, zorder=0)
    for name, (x, y) in points.items():
        axes.plot(x, y, "o", markersize=7, color=FRONT if name in front else DOT)
        axes.annotate(name, (x, y), xytext=(6, 5), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", xlabel=cost, ylabel=gain, title=f"{title} (red: beaten by none in both)")
    axes.margins(0.25, 0.12)
    axes.grid(alpha=0.25, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def pareto_front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """The names of the points (cost, gain) on the Pareto front: no other is cheaper and at least as good, or better and as cheap."""
    return [
        name
        for name, (cost, gain) in points.items()
        if not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in points.values())
    ]
