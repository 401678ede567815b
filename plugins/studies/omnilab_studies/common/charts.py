"""Figures and tables in which studies compare methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.descriptors.linearity.curves import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 130
FRONT, DOT = "#d1403f", "#2f6db3"
STYLES = ("-", "--", "-.", ":")  # a cycle of its own beside the ten colours: more than ten distances differ


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """A table as Markdown, numbers with four digits."""
    head = [f"| {' | '.join(name.replace('_', ' ') for name in table)} |", f"|{'---|' * len(table)}"]
    rows = [f"| {' | '.join(_brief(cell) for cell in row)} |" for row in zip(*table.values(), strict=True)]
    return "\n".join([*head, *rows])


def _brief(cell: Any) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def curves(groups: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """One panel per descriptor with a curve per distance, each relative to its highest mean (Payá et al., 2016, fig. 7-11).

    Bands are one standard deviation over the lines, for the curve that is closest to a line.
    """
    from matplotlib.figure import Figure

    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    figure = Figure(figsize=(4.6 * columns, 3.9 * rows), dpi=DPI, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    colors = {name: f"C{i % 10}" for i, name in enumerate(dict.fromkeys(d for of in groups.values() for d in of))}
    for axes, (name, of) in zip(panels, groups.items(), strict=False):
        best = max(of, key=lambda distance: of[distance].r2_centred)
        for distance, curve in of.items():
            x, y = np.append(0, curve.distance_m), np.append(0, curve.relative)
            label = f"{distance}, r² {curve.r2_centred:.3f}"
            style = STYLES[list(colors).index(distance) // 10 % len(STYLES)]
            axes.plot(x, y, style, color=colors[distance], linewidth=2.4 if distance == best else 1.1, label=label)
        curve = of[best]
        deviation = np.sqrt(curve.variance) * curve.relative[-1] / curve.mean[-1]
        axes.fill_between(
            curve.distance_m,
            curve.relative - deviation,
            curve.relative + deviation,
            color=colors[best],
            alpha=0.15,
            lw=0,
        )
        axes.set(xlabel="metric distance [m]", ylabel="image distance", title=name, ylim=(0, 1.32), xlim=(0, None))
        axes.legend(fontsize=7, loc="lower right", frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def pareto(points: Mapping[str, tuple[float, float]], cost: str, gain: str, title: str) -> Figure:
    """Cost (logarithmic) against gain; a line joins those that no other beats in both."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 5.2), dpi=DPI, layout="constrained")
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
    """The names of points (cost, gain) than which no other is cheaper and at least as good, or better and as cheap."""
    return [
        name
        for name, (cost, gain) in points.items()
        if not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in points.values())
    ]


def bars(values: Mapping[str, Mapping[str, float]], label: str, title: str) -> Figure:
    """Horizontal bars for each name, one per kind of value, on a logarithmic axis."""
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys(kind for of in values.values() for kind in of))
    figure = Figure(figsize=(7.6, 1.2 + 0.22 * len(values) * (len(kinds) + 0.6)), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    height = 0.8 / len(kinds)
    rows = np.arange(len(values))
    for k, kind in enumerate(kinds):
        widths = [of.get(kind, np.nan) for of in values.values()]
        drawn = axes.barh(rows + (k - (len(kinds) - 1) / 2) * height, widths, height, label=kind, color=f"C{k}")
        axes.bar_label(drawn, [f"{width:.3g}" for width in widths], fontsize=7, padding=2)
    axes.set(yticks=rows, yticklabels=list(values), xscale="log", xlabel=label, title=title)
    axes.invert_yaxis()
    axes.margins(x=0.12, y=0.01)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=len(kinds), frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
