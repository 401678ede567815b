"""Figures of the study `steps`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.metrics import VERDICTS
from omnilab_studies.common.plots import COLORS, blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLES = {"any": "any heading", "on_grid": "headings on the angle grid"}
Rows = Sequence[Mapping[str, Any]]


def success(rows: Rows) -> Figure:
    """Nearest, second and wrong answers against the step: methods across, kinds of headings down (thesis, figure 4.13)."""
    names = list(dict.fromkeys(row["method"] for row in rows))
    kinds = list(dict.fromkeys(row["headings"] for row in rows))
    figure = blank_figure(0.9 + 2.9 * len(names), 0.6 + 2.7 * len(kinds))
    panels = figure.subplots(len(kinds), len(names), squeeze=False, sharex=True, sharey=True)
    for line, kind in zip(panels, kinds, strict=True):
        for axes, name in zip(line, names, strict=True):
            own = [row for row in rows if (row["method"], row["headings"]) == (name, kind)]
            under = np.zeros(len(own))
            for verdict in VERDICTS:
                share = 100 * np.array([row[f"{verdict}_rate"] for row in own])
                axes.bar(range(len(own)), share, 0.7, under, color=COLORS[verdict], label=verdict)
                under += share
            for x, row in enumerate(own):
                axes.text(x, 4, f"{100 * row['nearest_rate']:.0f} %", ha="center", color="white", fontsize=9)
            axes.set_xticks(range(len(own)), [f"{row['step_m']:g}" for row in own])
            axes.set_ylim(0, 100)
            axes.set_title(f"{name.replace('_', ' ')}, {TITLES[kind]}", fontsize=9)
            axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("step of the map [m]")
    for axes in panels[:, 0]:
        axes.set_ylabel("queries [%]")
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def heading_error(rows: Rows) -> Figure:
    """Mean error of the heading against the step (thesis, figure 4.14); medians dotted."""
    style = style_of(list(dict.fromkeys(row["method"] for row in rows)))
    rows = [row for row in rows if np.isfinite(row["heading_error_mean_deg"])]  # some methods tell no heading
    names = list(dict.fromkeys(row["method"] for row in rows))
    kinds = list(dict.fromkeys(row["headings"] for row in rows)) or [next(iter(TITLES))]
    figure = blank_figure(0.9 + 3.9 * len(kinds), 3.8)
    for axes, kind in zip(figure.subplots(1, len(kinds), squeeze=False, sharey=True)[0], kinds, strict=True):
        for name in names:
            own = [row for row in rows if (row["method"], row["headings"]) == (name, kind)]
            steps = [row["step_m"] for row in own]
            axes.plot(steps, [row["heading_error_mean_deg"] for row in own], label=name, **style[name])
            medians = [row["heading_error_median_deg"] for row in own]
            axes.plot(steps, medians, ":", color=style[name]["color"], linewidth=1.4)
        axes.set(xlabel="step of the map [m]", title=TITLES[kind])
        axes.set_xticks(steps := sorted({row["step_m"] for row in rows}), [f"{step:g}" for step in steps])
        plain_axes(axes)
    figure.axes[0].set_ylabel("error of the heading [deg]")
    plain_logarithmic(figure.axes[0], "y")  # which the others share
    figure.axes[0].plot([], [], ":", color="black", label="medians")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return figure
