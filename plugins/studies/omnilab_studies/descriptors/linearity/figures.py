"""Figures of the study `linearity`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from omnilab_studies.common.plots import CURVES, blank_figure, plain_axes
from omnilab_studies.descriptors.curves import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLES = ("-", "--", "-.", ":")  # a cycle of its own beside the ten colours: more than ten distances differ


def curves(groups: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """One panel per descriptor with a curve per distance, each divided by its highest mean (Payá et al., 2016, fig. 7-11).

    Bands are one standard deviation over the lines, for the curve that is closest to a line.
    """
    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    most = max(len(of) for of in groups.values())
    figure = blank_figure(4.6 * columns, (3.9 + 0.08 * most) * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    colors = {
        name: CURVES[i % len(CURVES)] for i, name in enumerate(dict.fromkeys(d for of in groups.values() for d in of))
    }
    for axes, (name, of) in zip(panels, groups.items(), strict=False):
        best = max(of, key=lambda distance: of[distance].r2_centred)
        for distance, curve in of.items():
            x, y = np.append(0, curve.distance_m), np.append(0, curve.relative)
            label = f"{distance}, r² {curve.r2_centred:.3f}"
            style = STYLES[list(colors).index(distance) // 10 % len(STYLES)]
            axes.plot(x, y, style, color=colors[distance], linewidth=2.4 if distance == best else 1.1, label=label)
        curve = of[best]
        deviation = curve.relative_deviation
        axes.fill_between(
            curve.distance_m,
            curve.relative - deviation,
            curve.relative + deviation,
            color=colors[best],
            alpha=0.15,
            lw=0,
        )
        axes.set(xlabel="metric distance [m]", ylabel="image distance / its highest mean", title=name.replace("_", " "))
        axes.set(ylim=(0, 1.22), xlim=(0, None))
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, frameon=False)
        plain_axes(axes)
    return figure
