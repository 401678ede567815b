"""Figures of the study `resolution`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnilab_studies.common.plots import CURVES, MARKERS, blank_figure

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
    right.set(yscale="log", ylabel="ms a query")
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
    figure = blank_figure(10.5, 4.4)
    left, right = figure.subplots(1, 2, sharey=True)
    for curve, rows in curves.items():
        if curve[1] != "any":
            continue
        style = _styles(curves)[curve] | {"linestyle": ":", "label": curve[0]}
        rates = [100 * row["nearest_rate"] for row in rows]
        up = 4 if curve[0] == next(iter(curves))[0] else -9  # labels of two curves apart
        for axes, cost in (
            (left, [row["bytes_per_place"] / 1024 for row in rows]),
            (right, [row["describe_ms"] + row["locate_ms"] for row in rows]),
        ):
            axes.plot(cost, rates, **style)
            for x, y, row in zip(cost, rates, rows, strict=True):
                axes.annotate(row["size"], (x, y), fontsize=6, xytext=(3, up), textcoords="offset points")
    left.set(xscale="log", xlabel="KiB a place", ylabel="nearest, any heading [%]")
    right.set(xscale="log", xlabel="ms a query: describe and localise")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    left.legend(fontsize=8, frameon=False)
    return figure
