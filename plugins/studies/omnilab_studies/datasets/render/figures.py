"""Figures of the study `render`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab_studies.common.plots import COLORS, as_floor_plan, blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

SHEET = 6  # images on the sheet of a data set


def sheet(images: Sequence[Bytes], numbers: Ints, poses: Floats | None, shown: Floats | None) -> Figure:
    """Some images of a data set, beside all its poses (N, 4, 4): in the plan or, where heights differ, in space."""
    figure = blank_figure(13.0, 5.6)
    sides = figure.subfigures(1, 2, width_ratios=(1, 1.35), squeeze=False)[0]
    grid = sides[1].subplots(2, SHEET // 2, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, image, n in zip(grid, images, numbers, strict=False):
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        axes.set_title(f"{n}", fontsize=9)
    if poses is not None and shown is not None:
        flat = bool(np.ptp(poses[:, 2, 3]) < 1e-6)
        (_plan if flat else _space)(sides[0], poses, shown, numbers)
    return figure


def _plan(figure: SubFigure, poses: Floats, shown: Floats, numbers: Ints) -> None:
    axes = figure.subplots()
    axes.plot(*poses[:, :2, 3].T, ".", color="#8b93a1", markersize=4)
    for pose, n in zip(shown, numbers, strict=True):
        axes.annotate(f"{n}", pose[:2, 3], fontsize=8, color=COLORS["wrong"], xytext=(3, 3), textcoords="offset points")
    axes.quiver(*shown[:, :2, 3].T, *shown[:, :2, 0].T, color=COLORS["wrong"], width=0.006, scale=14)
    axes.margins(0.1)
    as_floor_plan(axes, f"{len(poses)} poses; arrows: the camera's +x")


def _space(figure: SubFigure, poses: Floats, shown: Floats, numbers: Ints) -> None:
    axes: Any = figure.subplots(subplot_kw={"projection": "3d"})
    axes.plot(*poses[:, :3, 3].T, ".", color="#8b93a1", markersize=4)
    length = 0.12 * max(float(np.ptp(poses[:, :3, 3], axis=0).max()), 0.5)
    axes.quiver(*shown[:, :3, 3].T, *shown[:, :3, 0].T, color=COLORS["wrong"], length=length)
    for pose, n in zip(shown, numbers, strict=True):
        axes.text(*pose[:3, 3], f" {n}", fontsize=8, color=COLORS["wrong"])
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title=f"{len(poses)} poses; arrows: the camera's +x")
    axes.set_aspect("equal")
