"""A camera of one model as near as can be to one of another."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from omnilab.cameras.calibration.models import MODELS, like, sample_rays
from omnilab.cameras.lenses import AxialCamera


class Refit(NamedTuple):
    """The camera, and how far it shows rays from where the other does, within the circle of that."""

    camera: AxialCamera
    rms_px: float
    largest_px: float


def refit(camera: AxialCamera, name: str) -> Refit:
    """The camera of one of `MODELS` that shows rays where `camera` does, by least squares over its image circle."""
    model = MODELS[name]
    reach = min(camera.circle.radius, float(np.hypot(camera.width, camera.height)))
    around = np.arange(16) * np.pi / 8
    ring = np.stack([camera.cx + 0.999 * reach * np.cos(around), camera.cy + 0.999 * reach * np.sin(around)], -1)
    largest = float(np.nanmin(np.arccos(np.clip(camera.rays(ring)[:, 2], -1, 1))))
    found = model.camera(like(model, camera, largest), camera.width, camera.height)
    rays = sample_rays(largest)
    distance = np.linalg.norm(found.image_points(rays) - camera.image_points(rays), axis=-1)
    framed = replace(found, rim_px=camera.rim_px, inner_px=camera.inner_px, looks=camera.looks)
    return Refit(framed, float(np.sqrt(np.mean(distance**2))), float(distance.max()))
