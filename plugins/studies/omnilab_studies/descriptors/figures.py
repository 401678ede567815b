"""Cost against accuracy of descriptors: the Pareto front."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from omnilab_studies.common.plots import blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRONT = "#8b93a1"


def pareto(points: Mapping[str, tuple[float, float]], cost: str, gain: str, title: str) -> Figure:
    """Cost (logarithmic) against gain; a line joins the Pareto front, whose names come first in the legend."""
    figure = blank_figure(8.8, max(4.6, 1.0 + 0.23 * len(points)))
    axes = figure.subplots()
    front = pareto_front(points)
    best = sorted(points[name] for name in front)
    axes.step(
        *zip(*best, strict=True), where="post", color=FRONT, linewidth=1, zorder=0, label="beaten by none in both:"
    )
    style = style_of(list(points))
    for name in [*sorted(front, key=lambda name: points[name]), *(n for n in points if n not in front)]:
        axes.plot(*points[name], linestyle="", markersize=8, label=name, **style[name])
    axes.set(xlabel=cost, ylabel=gain)
    axes.set_title(title, fontsize=11)
    axes.margins(0.08, 0.08)
    plain_logarithmic(axes)
    plain_axes(axes)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def pareto_front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """The names of the points (cost, gain) on the Pareto front: no other is cheaper and at least as good, or better and as cheap."""
    return [
        name
        for name, (cost, gain) in points.items()
        if not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in points.values())
    ]
