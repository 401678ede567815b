"""Tilt of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, CalibratedCamera, Camera, Floats, check_settings, setting
from omnilab.cameras import reproject
from omnilab.cameras.base import PanoramaCamera
from omnilab.errors import DataError

NOWHERE = -1e4  # pixel coordinate of what the image does not show


@dataclass
class Tilt:
    """The view of a camera rotated by an angle about a horizontal axis through its viewpoint, right-handed.

    Exact but for interpolation, as a rotation about the viewpoint makes no parallax: `T_world_camera` becomes
    `T_world_camera` times the rotation (the poses that a study scores with stay those of the upright camera). What
    the upright image does not show is black. Only for calibrated cameras.
    """

    angle_deg: float = setting(5.0, at_least=-180, at_most=180)  # of the lean
    axis_deg: float | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # azimuth of the axis in the camera frame; null: drawn for each image

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:
        """The images as the leaning camera would have taken them."""
        if not isinstance(camera, CalibratedCamera):
            raise DataError(
                f"a tilt needs a camera that knows where its pixels look, which {type(camera).__name__} does not;"
                " leave the disturbance tilt out, or choose a calibrated sensor such as sensor=mirror"
            )
        tilted = images.copy()
        if self.angle_deg == 0:
            return tilted
        directions = camera.directions(np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1))
        for image, rng in zip(tilted, rngs, strict=True):
            R_upright_leaning = self._rotation(rng)
            if isinstance(camera, PanoramaCamera):
                image[...] = reproject(image[None], camera, camera, R_upright_leaning)[0]
            else:
                image[...] = _sample(image, camera.pixels(directions @ R_upright_leaning.T))
        return tilted

    def _rotation(self, rng: np.random.Generator) -> Floats:
        """`R_upright_leaning` (3, 3)."""
        azimuth = rng.uniform(0, 2 * np.pi) if self.axis_deg is None else np.deg2rad(self.axis_deg)
        x, y = np.cos(azimuth), np.sin(azimuth)
        K = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])  # the cross product with the axis (x, y, 0)
        angle = np.deg2rad(self.angle_deg)
        return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)  # Rodrigues


def _sample(image: Bytes, pixels: Floats) -> Bytes:
    """The image at pixels (H, W, 2), bilinear; 0 where they are NaN or outside."""
    import cv2

    u, v = np.moveaxis(np.nan_to_num(pixels, nan=NOWHERE).astype(np.float32), -1, 0)
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), np.uint8)
