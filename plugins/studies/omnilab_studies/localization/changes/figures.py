"""Figures of the study `changes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes
from omnilab.metrics import VERDICTS
from omnilab_studies.common.plots import COLORS, blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rates(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Nearest, second and wrong answers in every condition, a panel a method (thesis, figure 4.18)."""
    names = list(dict.fromkeys(row["method"] for row in rows))
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    columns = min(4, len(names))
    lines = -(-len(names) // columns)
    figure = blank_figure(1.6 + 0.75 * len(conditions) * columns, 0.6 + 3.6 * lines)
    panels = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for axes in panels.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, names, strict=False):
        own = [row for row in rows if row["method"] == name]
        under = np.zeros(len(own))
        for verdict in VERDICTS:
            share = 100 * np.array([row[f"{verdict}_rate"] for row in own])
            axes.bar(range(len(own)), share, 0.72, under, color=COLORS[verdict], label=verdict)
            under += share
        for x, row in enumerate(own):
            low, high = 100 * row["nearest_low"], 100 * row["nearest_high"]
            axes.plot([x, x], [low, high], color="black", linewidth=1)
            axes.text(
                x, 100 * row["nearest_rate"] / 2, f"{100 * row['nearest_rate']:.0f} %", ha="center", color="white"
            )
        axes.set_xticks(range(len(own)), [row["condition"].replace("_", " ") for row in own], rotation=30, ha="right")
        axes.set(ylim=(0, 100), title=name.replace("_", " "))
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel("queries [%]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def pictures(shown: Mapping[str, Bytes]) -> Figure:
    """The first query of every condition."""
    columns = min(5, len(shown))
    rows = -(-len(shown) // columns)
    figure = blank_figure(2.4 * columns, 2.6 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, (name, picture) in zip(grid, shown.items(), strict=False):
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255)
        axes.set_title(name, fontsize=10)
    return figure
