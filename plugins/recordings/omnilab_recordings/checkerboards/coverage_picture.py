"""The picture of a calibration: corners over the image plane with their errors, and how errors and corners lie by radius."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes
from omnilab.atomic_files import write_whole
from omnilab.cameras.calibration import CalibrationResult
from omnilab.cameras.calibration.bundle import rms

RINGS = 16  # of the histogram
ARROW = 0.03  # of the picture's width, that a large error's arrow is long
CORNER, ERROR, RIM, BARS = "#00a5cf", "#ff4d6d", "#ffd400", "#4a6fa5"


def write_coverage_picture(file: Path, calibration: CalibrationResult, background: Bytes | None) -> None:
    """Draw the corners that were fitted, and their errors magnified; `background` is a picture (H, W) of the camera."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 7.2), layout="constrained")
    FigureCanvasAgg(figure)
    chosen = calibration.chosen
    figure.suptitle(
        f"{chosen.fit.model.name}: {chosen.fit.rms_px:.3f} px rms, {chosen.held_out_px:.3f} px on boards left out,"
        f" {len(calibration.corners.names)} boards of {calibration.corners.board} corners"
    )
    parts = figure.add_gridspec(2, 2, width_ratios=[1.7, 1])
    _draw_plane(figure.add_subplot(parts[:, 0]), calibration, background)
    above = figure.add_subplot(parts[0, 1])
    _draw_coverage(above, calibration)
    _draw_errors(figure.add_subplot(parts[1, 1], sharex=above), calibration)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=100, format="png")
    write_whole(file, lambda out: out.write(picture.getbuffer()))


def _draw_plane(axes: Any, calibration: CalibrationResult, background: Bytes | None) -> None:
    from matplotlib.patches import Circle as Ring

    camera, corners, errors = calibration.camera, calibration.corners, calibration.chosen.fit.errors_px
    if background is not None:
        extent = (-0.5, camera.width - 0.5, camera.height - 0.5, -0.5)
        axes.imshow(background // 2 + 127, cmap="gray", vmin=0, vmax=255, extent=extent)
    seen = corners.seen
    u, v = corners.pixels[seen].T
    du, dv = errors[seen].T
    factor = magnification(float(np.percentile(np.hypot(du, dv), 95)), camera.width)
    axes.scatter(u, v, s=5, color=CORNER, label="corners")
    axes.quiver(
        u, v, factor * du, factor * dv, angles="xy", scale_units="xy", scale=1, color=ERROR, width=0.0018,
        label=f"errors, {factor:g} times as long",
    )  # fmt: skip
    axes.plot(camera.cx, camera.cy, "+", color="black", markersize=12, label="axis")
    for radius in filter(None, (camera.rim_px, camera.inner_px)):
        axes.add_patch(Ring((camera.cx, camera.cy), radius, fill=False, color=RIM, linewidth=2))
    axes.set(
        xlim=(-0.5, camera.width - 0.5),
        ylim=(camera.height - 0.5, -0.5),
        aspect="equal",
        xlabel="u [px]",
        ylabel="v [px]",
    )
    axes.legend(loc="lower right", fontsize=8)


def magnification(large_px: float, width: int) -> float:
    """A round factor (1, 2 or 5 times a power of ten) that makes a large error's arrow `ARROW` of the width long, or less."""
    wanted = ARROW * width / max(large_px, 1e-9)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def _radii(calibration: CalibrationResult) -> Any:
    camera, corners = calibration.camera, calibration.corners
    return np.linalg.norm(corners.pixels - [camera.cx, camera.cy], axis=-1)


def _edges(calibration: CalibrationResult) -> Any:
    return np.linspace(0, max(calibration.rim_px, float(np.nanmax(_radii(calibration)))) * 1.001, RINGS + 1)


def _draw_coverage(axes: Any, calibration: CalibrationResult) -> None:
    radius, edges = _radii(calibration), _edges(calibration)
    axes.hist(radius[np.isfinite(radius)], edges, color=BARS)
    axes.axvline(
        calibration.rim_px, color=RIM, linewidth=2, label="rim" if calibration.camera.rim_px else "nearest edge"
    )
    axes.axvline(calibration.reach_px, color=ERROR, linestyle="--", label="98 % of the corners")
    axes.set(title="how far from the axis corners were seen", ylabel="corners")
    axes.legend(fontsize=8)


def _draw_errors(axes: Any, calibration: CalibrationResult) -> None:
    fit, edges, radius = calibration.chosen.fit, _edges(calibration), _radii(calibration)
    ring = np.digitize(radius, edges) - 1
    errors = [rms(fit.errors_px[ring == i]) if (ring == i).any() else 0.0 for i in range(RINGS)]
    axes.bar(edges[:-1], errors, np.diff(edges), align="edge", color=BARS, label="error of corners, rms")
    angle = np.deg2rad(list(calibration.uncertainty_px))
    away = fit.camera.image_points(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1))[:, 0] - fit.camera.cx
    axes.plot(
        away, list(calibration.uncertainty_px.values()), "o-", color=ERROR, label="uncertainty of the camera, one sigma"
    )
    axes.set(title="by the distance from the axis", xlabel="px from the axis", ylabel="px")
    axes.legend(fontsize=8)
