"""Report picture of `omnilab check`: a sample with its circle, its panorama, the map, and more samples."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes, Camera, RecordedPoses
from omnilab.atomic_files import write_whole
from omnilab.geometry import heading_of
from omnilab.image import panorama
from omnilab_recordings.checks.handedness import Handedness
from omnilab_recordings.folder import Folder
from omnilab_recordings.images.decoding import reduce_by, reduction

THUMBNAILS = 8
PANORAMA = (160, 960)  # rows, columns
RING, HORIZON, AZIMUTH, FRONT = "#00e5ff", "#ffd400", "#ff4d6d", "#7CFC00"


def write_report_picture(file: Path, sensor: Folder, level: float | None, found: Handedness) -> None:
    """Draw the folder as a sensor with these settings hands it over; `level` is the horizon's in the panorama."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    images, names, camera = _samples(sensor)
    middle = len(images) // 2
    figure = Figure(figsize=(13, 10), layout="constrained")
    FigureCanvasAgg(figure)
    title = f"{Path(sensor.path).resolve().name}: {len(sensor.recording.images)} images"
    figure.suptitle(title + ", flipped left to right" * sensor.mirrored)
    has_map = sensor.recording.positions is not None
    halves = figure.add_gridspec(2, 1, height_ratios=[5.4, 4.3])
    above = halves[0].subgridspec(1, 1 + has_map)
    below = halves[1].subgridspec(2, len(images), height_ratios=[2.4, 1.9])
    front = found.turned_deg % 360 if found.is_mirrored is not None else None
    _draw_sample(figure.add_subplot(above[0]), images[middle], names[middle], camera, level, front)
    if has_map:
        _draw_map(figure.add_subplot(above[1]), sensor)
    _draw_panorama(figure.add_subplot(below[0, :]), panorama(images[middle][None], camera, PANORAMA)[0], level, front)
    for i, (image, name) in enumerate(zip(images, names, strict=True)):
        axes = figure.add_subplot(below[1, i])
        _show(axes, image)
        axes.set_title(Path(name).name[-22:], fontsize=7)
        axes.axis("off")
    picture = io.BytesIO()
    figure.savefig(picture, dpi=110, format=file.suffix[1:] or "png")
    write_whole(file, lambda out: out.write(picture.getbuffer()))


def _samples(sensor: Folder) -> tuple[list[Bytes], list[str], Camera]:
    """Some pictures from all over the recording."""
    plan = sensor.plan_of(sensor.recording.rows(RecordedPoses()))
    chosen = plan.at(np.unique(np.linspace(0, len(plan) - 1, THUMBNAILS).astype(int)))
    batches = list(sensor.frames(chosen))
    names = [chosen.keys[i] for frames in batches for i in frames.plan_index]
    return [image for frames in batches for image in frames.images], names, batches[0].camera


def _show(axes: Any, image: Bytes) -> None:
    """An image, a large one reduced, in its own pixels' coordinates."""
    height, width = image.shape
    shown = reduce_by(image, reduction(image.shape))
    axes.imshow(shown, cmap="gray", vmin=0, vmax=255, extent=(-0.5, width - 0.5, height - 0.5, -0.5))


def _draw_sample(axes: Any, image: Bytes, name: str, camera: Camera, level: float | None, front: float | None) -> None:
    from matplotlib.patches import Circle as Ring

    _show(axes, image)
    ring = camera.circle
    for radius, label in ((ring.radius, "circle"), (ring.inner, None)) if ring.radius else ():
        axes.add_patch(Ring((ring.cx, ring.cy), radius, fill=False, color=RING, linewidth=1.5, label=label))
    if level is not None:
        u, v = camera.unwrap(np.linspace(0, 2 * np.pi, 361), np.full(361, level)).T
        axes.plot(u, v, "--", color=HORIZON, linewidth=1.5, label="horizon, about")
    if ring.radius:
        _draw_ray(axes, camera, 0.0, AZIMUTH, "azimuth 0, counter-clockwise")
        if front is not None:
            _draw_ray(axes, camera, front, FRONT, f"where yaw points, {front:.0f}°")
    axes.legend(loc="lower right", fontsize=8)
    axes.set(title=name, xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5))
    axes.axis("off")


def _draw_ray(axes: Any, camera: Camera, azimuth_deg: float, color: str, label: str) -> None:
    ends = camera.unwrap(np.deg2rad([azimuth_deg] * 2), np.array([0.0, 1.0]))
    axes.plot(*ends.T, color=color, linewidth=2, label=label)


def _draw_map(axes: Any, sensor: Folder) -> None:
    positions = sensor.recording.positions
    assert positions is not None
    x, y, _ = positions.position_m.T
    heading = heading_of(positions.R_world_robot)
    dots = axes.scatter(x, y, c=np.arange(len(x)), s=14, zorder=3)
    axes.quiver(x, y, np.cos(heading), np.sin(heading), color="0.6", width=0.002, scale=30)
    axes.figure.colorbar(dots, ax=axes, label="image", shrink=0.7)
    axes.set(title="positions, and where yaw points", xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.margins(0.08)


def _draw_panorama(axes: Any, image: Bytes, level: float | None, front: float | None) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=(0, 360, 0, 1), aspect="auto")
    if level is not None:
        axes.axhline(level, ls="--", color=HORIZON, linewidth=1.5)
    if front is not None:
        axes.axvline(front, color=FRONT, linewidth=2)
    axes.axvline(0, color=AZIMUTH, linewidth=3)
    axes.set(title="its panorama, over the azimuth in degrees, counter-clockwise", xticks=range(0, 361, 45), yticks=[])
