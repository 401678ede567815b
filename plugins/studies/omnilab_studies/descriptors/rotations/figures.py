"""Figures of the study `rotations`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]


def against_distance(rows: Rows) -> Figure:
    """The median error of the rotation and of the heading against the distance between the images, with quartiles."""
    names = list(dict.fromkeys(row["method"] for row in rows))
    style = style_of(names)
    figure = blank_figure(9.6, 4.2)
    for axes, what in zip(figure.subplots(1, 2, sharey=True), ("rotation", "heading"), strict=True):
        for name in names:
            own = [row for row in rows if row["method"] == name]
            x = [row["distance_m"] for row in own]
            axes.plot(x, [max(0.01, row[f"{what}_error_median_deg"]) for row in own], label=name, **style[name])
            low, high = ([max(0.01, row[f"{what}_error_{q}_deg"]) for row in own] for q in ("q25", "q75"))
            axes.fill_between(x, low, high, color=style[name]["color"], alpha=0.12, lw=0)
        axes.set(xlabel="distance between the images [m]", title=f"error of the {what}")
        plain_axes(axes)
    plain_logarithmic(figure.axes[0], "y")  # which the other shares
    figure.axes[0].set_ylabel("median error, quartiles [deg]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def distribution(errors_deg: Mapping[str, np.ndarray[Any, Any]]) -> Figure:
    """The share of the pairs whose rotation is right within an angle, for each method."""
    style = style_of(list(errors_deg))
    figure = blank_figure(5.6, 4.2)
    axes = figure.subplots()
    for name, errors in errors_deg.items():
        x = np.sort(np.maximum(errors, 0.01))
        share = 100 * np.arange(1, len(x) + 1) / len(x)
        axes.step(x, share, where="post", color=style[name]["color"], label=name)
    axes.set(xlabel="error of the rotation [deg]", ylabel="pairs with less [%]", ylim=(0, 101))
    plain_axes(axes)
    plain_logarithmic(axes)
    axes.legend(frameon=False, fontsize=8)
    return figure
