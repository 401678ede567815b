"""Figures of the study `parameter_curves`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omnilab_studies.common.methods import key_of
from omnilab_studies.common.plots import blank_figure, plain_axes, style_of
from omnilab_studies.descriptors.parameter_curves.points import Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS = {
    "fit_ms": "training, ms an image", "fit_cpu_ms": "training, processor's ms an image",
    "describe_ms": "description, ms an image", "describe_cpu_ms": "description, processor's ms an image",
    "bytes": "bytes an image",
    "r2": "r² (centred) of the line", "nearest": "answered the nearest place [%]", "heading_error": "heading error, median [deg]",
}  # fmt: skip
OF_DESCRIPTOR = ("fit_ms", "fit_cpu_ms", "describe_ms", "describe_cpu_ms", "bytes")  # alike for all distances
LOWEST_R2 = -1.0  # drawn: below, a curve is bent by so much that by how much does not count
WIDE = 8  # values whose largest is so many times the smallest are drawn on a logarithmic axis


def curves_of(points: Sequence[Point]) -> Mapping[tuple[str, str, str], list[Point]]:
    """The points of each curve, by parameter, quantity, and method or descriptor; training where there is any."""
    found: dict[tuple[str, str, str], list[Point]] = {}
    for point in points:
        for name in LABELS:
            if name not in point.found or (name.startswith("fit_") and not point.found[name].value):
                continue
            of_descriptor = name in OF_DESCRIPTOR
            key = (point.parameter, name, point.method.descriptor_name if of_descriptor else key_of(point.method.name))
            own = found.setdefault(key, [])
            if not own or own[-1].value != point.value:  # of a descriptor with several distances, once
                own.append(point)
    return found


def against(points: Sequence[Point]) -> Figure:
    """All that was measured against every parameter, a column a parameter; bands are 95 % intervals."""
    curves = curves_of(points)
    names = [name for name in LABELS if any(name == curve[1] for curve in curves)]
    parameters = list(dict.fromkeys(point.parameter for point in points))
    figure = blank_figure(1.2 + 3.6 * len(parameters), 0.9 + 2.6 * len(names))
    panels = figure.subplots(len(names), len(parameters), squeeze=False, sharex="col")
    for row, name in zip(panels, names, strict=True):
        for axes, parameter in zip(row, parameters, strict=True):
            own = {curve[2]: at for curve, at in curves.items() if curve[:2] == (parameter, name)}
            _draw(axes, name, own)
            if not own:
                axes.set_axis_off()
    for axes, parameter in zip(panels[-1], parameters, strict=True):
        _value_axis(axes, parameter, [point.value for point in points if point.parameter == parameter])
    return figure


def _draw(axes: Axes, name: str, curves: Mapping[str, Sequence[Point]]) -> None:
    """One quantity against one parameter, a curve a method."""
    scale = 100 if name == "nearest" else 1
    for (method, points), style in zip(curves.items(), style_of(list(curves)).values(), strict=True):
        x = [point.value for point in points]
        value, low, high = (scale * np.array(column) for column in zip(*(p.found[name] for p in points), strict=True))
        axes.plot(x, value, markersize=4, linewidth=1.4, label=method, **style)
        axes.fill_between(x, low, high, color=style["color"], alpha=0.18, lw=0)
    axes.set_ylabel(LABELS[name], fontsize=8)
    if name == "r2":
        axes.set_ylim(max(axes.get_ylim()[0], LOWEST_R2), 1.02)
    else:
        axes.set_ylim(bottom=0)
    if name == "nearest":
        axes.set_ylim(0, 103)
    axes.tick_params(labelsize=8)
    plain_axes(axes)
    axes.legend(fontsize=7, frameon=False)


def _value_axis(axes: Axes, parameter: str, values: Sequence[float]) -> None:
    """The axis of a parameter, logarithmic where its values are far apart, with ticks at them."""
    values = sorted(set(values))
    if values[0] > 0 and values[-1] >= WIDE * values[0]:
        axes.set_xscale("log")
    axes.set_xticks(values, [f"{value:g}" for value in values])
    axes.minorticks_off()
    axes.set_xlabel(parameter)


def distance_curves(points: Sequence[Point]) -> Figure:
    """A panel a method: image distance over metric distance, a curve a value (Payá et al., 2016, figures 7-11).

    Each curve is relative to its own highest mean; bands are the mean's 95 % intervals.
    """
    from matplotlib import colormaps

    methods = list(dict.fromkeys(point.method.name for point in points))
    values = sorted({point.value for point in points})
    colors = dict(zip(values, colormaps["viridis"](np.linspace(0, 0.9, len(values))), strict=True))
    columns = min(3, len(methods))
    rows = -(-len(methods) // columns)
    figure = blank_figure(4.4 * columns, 3.6 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(methods) :]:
        axes.set_axis_off()
    for axes, method in zip(panels, methods, strict=False):
        for point in (p for p in points if p.method.name == method):
            assert point.line is not None
            curve, highest = point.line.curve, point.line.curve.mean.max() or 1.0
            label = f"{point.value:g}: r² {curve.r2_centred:.3f}"
            x = np.append(0, curve.distance_m)
            axes.plot(x, np.append(0, curve.mean / highest), color=colors[point.value], linewidth=1.4, label=label)
            low, high = point.line.low / highest, point.line.high / highest
            axes.fill_between(curve.distance_m, low, high, color=colors[point.value], alpha=0.15, lw=0)
        axes.set(xlabel="metric distance [m]", ylabel="image distance", title=method, xlim=(0, None), ylim=(0, None))
        axes.legend(fontsize=7, frameon=False, loc="lower right", title=points[0].parameter, title_fontsize=7)
        plain_axes(axes)
    return figure
