"""Figures of the study `lifelong_map`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab_studies.common.plots import blank_figure, plain_axes, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVES = {"signatures": "signatures of\nthe map", "wrong_signatures": "of these at a\nwrong place"}


def days(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Rates of nearest answers with their intervals, signatures, and those at wrong places, against days."""
    names = list(dict.fromkeys(row["policy"] for row in rows))
    first = [row for row in rows if row["policy"] == names[0]]
    figure = blank_figure(max(5.5, 1.8 + 0.5 * len(first)), 7.2)
    top, *below = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1, 1))
    for i, (name, style) in enumerate(style_of(names).items()):
        own = [row for row in rows if row["policy"] == name]
        x = np.array([row["day"] for row in own])
        rate, low, high = (100 * np.array([row[f"nearest_{key}"] for row in own]) for key in ("rate", "low", "high"))
        beside = x + 0.1 * (i - (len(names) - 1) / 2)  # so that no interval hides another
        top.errorbar(
            beside, rate, [rate - low, high - rate], **style, label=name.replace("_", " "), markersize=5, linewidth=1.2
        )
        for axes, column in zip(below, CURVES, strict=True):
            axes.plot(x, [row[column] for row in own], **style, markersize=4, linewidth=1.2)
    top.set(ylabel="nearest answers [%]", ylim=(0, 103))
    for axes, label in zip(below, CURVES.values(), strict=True):
        axes.set(ylabel=label)
        axes.set_ylim(bottom=0)
    for axes in (top, *below):
        plain_axes(axes)
    labels = [f"{row['day']}: {row['condition'].replace('_', ' ')}" for row in first]
    below[-1].set_xticks([row["day"] for row in first], labels, rotation=40, ha="right")
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=len(names), frameon=False)
    return figure
