"""Figures of the study `resolution`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnilab_studies.common.plots import CURVES, MARKERS, blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Curves = Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]


def _styles(curves: Curves) -> dict[tuple[str, str], dict[str, Any]]:
    """A colour and marker for each distance; full lines where headings are on the grid, dashed ones elsewhere."""
    distances = list(dict.fromkeys(distance for distance, _ in curves))
    return {
        (distance, headings): {
            "color": CURVES[distances.index(distance) % len(CURVES)],
            "marker": MARKERS[distances.index(distance) % len(MARKERS)],
            "linestyle": "-" if headings == "on_grid" else "--",
            "label": f"{distance}, {'headings on the angle grid' if headings == 'on_grid' else 'any heading'}",
        }
        for distance, headings in curves
    }


def resolution(curves: Curves) -> Figure:
    """Rates of nearest estimates and times of one query, size by size (thesis, figure 4.22)."""
    figure = blank_figure(11.5, 4.6)
    left, right = figure.subplots(1, 2)
    styles = _styles(curves)
    sizes = [row["size"] for row in next(iter(curves.values()))]
    for curve, rows in curves.items():
        left.plot([100 * row["nearest_rate"] for row in rows], linewidth=1.8, **styles[curve])
    right.plot([row["describe_ms"] for row in next(iter(curves.values()))], "k^-", label="describe an image")
    for curve, rows in curves.items():
        if curve[1] == "any":
            style = styles[curve] | {"label": f"localise with {curve[0]}", "linestyle": "-"}
            right.plot([row["locate_ms"] for row in rows], **style)
    right.set_ylabel("ms a query")
    plain_logarithmic(right, "y")
    left.set(ylim=(0, 103), ylabel="nearest [%]")
    for axes in (left, right):
        axes.set_xticks(range(len(sizes)), sizes, rotation=40, ha="right")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
        axes.legend(fontsize=8, frameon=False, handlelength=3.5)
    figure.supxlabel("size of the signature", fontsize=10)
    return figure


def pareto(curves: Curves) -> Figure:
    """Cost against accuracy: bytes of a place, and time of a query, with any heading."""
    figure = blank_figure(11.5, 4.4)
    left, right = figure.subplots(1, 2, sharey=True)
    of_sizes = style_of([row["size"] for row in next(iter(curves.values()))])
    for curve, rows in curves.items():
        if curve[1] != "any":
            continue
        color = _styles(curves)[curve]["color"]
        rates = [100 * row["nearest_rate"] for row in rows]
        for axes, cost in (
            (left, [row["bytes_per_place"] / 1024 for row in rows]),
            (right, [row["describe_ms"] + row["locate_ms"] for row in rows]),
        ):
            axes.plot(cost, rates, ":", color=color, label=curve[0])
            for x, y, row in zip(cost, rates, rows, strict=True):
                axes.plot(x, y, ls="", ms=8, color=color, marker=of_sizes[row["size"]]["marker"])
    for size, style in of_sizes.items():
        right.plot([], [], ls="", ms=8, color="#5b6470", marker=style["marker"], label=size)
    left.set(xlabel="KiB a place", ylabel="nearest, any heading [%]")
    right.set(xlabel="ms a query: describe and localise")
    for axes in (left, right):
        plain_logarithmic(axes)
        plain_axes(axes)
    right.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure
