"""Figures of the study `views`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_studies.common.plots import blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def views(pictures: Sequence[Bytes], panoramas: Sequence[Bytes], poses: Sequence[Sequence[float]]) -> Figure:
    """Pictures from chosen poses, each above its panorama where there is one (thesis, figures 3.10 to 3.12)."""
    height, width = pictures[0].shape[:2]
    columns = min(len(pictures), 5 if width < 1.5 * height else 2)
    rows = -(-len(pictures) // columns)
    wide = min(15 / columns, 8)  # inches of a picture
    ratios = [wide * height / width + 0.3, *([wide * _aspect(panoramas[0])] if panoramas else [])]
    figure = blank_figure(wide * columns, rows * sum(ratios))
    axes = figure.subplots(len(ratios) * rows, columns, squeeze=False, height_ratios=ratios * rows)
    for one in axes.flat:
        one.set_axis_off()
    for i, picture in enumerate(pictures):
        row, column = len(ratios) * (i // columns), i % columns
        axes[row, column].imshow(picture, cmap="gray", vmin=0, vmax=255)
        axes[row, column].set_title(_pose_title(poses[i]), fontsize=9)
        if panoramas:
            axes[row + 1, column].imshow(panoramas[i], cmap="gray", vmin=0, vmax=255)
    return figure


def _aspect(picture: Bytes) -> float:
    return float(picture.shape[0] / picture.shape[1])


def _pose_title(pose: Sequence[float]) -> str:
    at = ", ".join(f"{value:g}" for value in pose[:3])
    turns = [f"θ{axis} = {angle:g}°" for axis, angle in zip("xyz", pose[3:], strict=True) if angle]
    return ", ".join([f"({at}) m", *turns])


def cloud(points_m: Floats, colors: Bytes) -> Figure:
    """A point cloud from above and aside (thesis, figure 3.13)."""
    figure = blank_figure(9, 6)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.scatter(*points_m.T, c=colors / 255, s=5, marker="o", linewidths=0)
    span = np.ptp(points_m, axis=0)
    axes.set_box_aspect(np.maximum(span, 0.1 * span.max()))
    axes.view_init(elev=30, azim=-60)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure
