"""Upright adjustment: the lean of the camera undone by the vertical lines that it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, Floats, check_settings, setting
from omnilab.cameras import RayCamera, reproject
from omnilab.cameras.sphere import sphere
from omnilab.errors import DataError
from omnilab.image import to_gray

LEAST = 3.0  # grey levels a degree: a weaker gradient is noise
ROUNDS = 10  # of the refinement
SMOOTH = 1.0  # pixels: the standard deviation of the derivative's filter


@dataclass
class UprightAdjustment:
    """What the camera would have taken had it stood upright: no disturbance, but what undoes the one of `tilt`.

    An edge of the picture is an arc of a great circle, whose normal is the gradient's direction on the sphere; the circles
    of vertical lines meet in the zenith. That is the direction, at most `largest_tilt_deg` from the camera's axis, that is
    perpendicular to most gradients: by a vote, then by iteratively reweighted least squares (after Bazin et al., 2007,
    and Jung et al., 2017, who take lines). The rotation about the zenith stays. A picture in which no edge votes for a
    lean stays as it is. Only for calibrated cameras, in places with walls, doors and furniture.
    """

    largest_tilt_deg: float = setting(20.0, at_least=0, at_most=45)  # that the camera may lean; 0: nothing is done
    spread_deg: float = setting(
        2.0, above=0, at_most=20
    )  # of the gradients of a vertical line from its circle's normal

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:
        """The images (N, H, W[, 3]) as the upright camera would have taken them; black where they did not show that."""
        del rngs  # nothing is drawn
        if not isinstance(camera, RayCamera):
            raise DataError(
                f"the upright adjustment needs a camera that knows where its pixels look, which {type(camera).__name__} does"
                " not; leave the disturbance upright_adjustment out, or choose a calibrated sensor such as sensor=mirror"
            )
        if self.largest_tilt_deg == 0:
            return images.copy()
        zeniths = [self.zenith(picture) for picture in sphere(to_gray(images), camera)]
        pairs = zip(images, zeniths, strict=True)
        return np.concatenate([reproject(image[None], camera, camera, _upright(z).T) for image, z in pairs])

    def zenith(self, picture: Bytes) -> Floats:
        """The unit direction (3,), in the camera's frame, in which the vertical lines of a sphere (H, 2 H) meet."""
        normals, weights = _gradients(picture)
        spread = np.sin(np.deg2rad(self.spread_deg))
        candidates = _cap(np.deg2rad(self.largest_tilt_deg), np.deg2rad(self.spread_deg))
        votes = np.array([weights @ np.exp(-((normals @ z / spread) ** 2) / 2) for z in candidates])
        if votes.max(initial=0) <= 0:
            return np.array([0.0, 0, 1])
        zenith = candidates[votes.argmax()]
        for _ in range(ROUNDS):
            w = weights * np.exp(-((normals @ zenith / spread) ** 2) / 2)
            zenith = np.linalg.eigh((normals * w[:, None]).T @ normals)[1][:, 0]
            zenith = zenith * np.sign(zenith[2])
        return np.asarray(zenith)


def _gradients(picture: Bytes) -> tuple[Floats, Floats]:
    """Unit directions (M, 3) of the gradients of a sphere (H, 2 H), which are tangent to it, and their weights (M,).

    Of pixels that are seen and whose neighbours are, and whose gradient is more than noise.
    """
    import cv2

    rows, columns = picture.shape
    wide = np.concatenate([picture[:, -2:], picture, picture[:, :2]], axis=1)
    smooth = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), SMOOTH)
    azimuth, elevation = 2 * np.pi * np.arange(columns) / columns, np.pi / 2 - np.pi * (np.arange(rows) + 0.5) / rows
    down = -np.gradient(smooth, axis=0)[:, 2:-2]  # towards higher elevations
    along = np.gradient(smooth, axis=1)[:, 2:-2] / np.cos(elevation)[:, None]
    length = np.hypot(down, along) * rows / 180  # grey levels a degree
    seen = cv2.erode((wide > 0).astype(np.uint8), np.ones((7, 7), np.uint8))[:, 2:-2] > 0
    strong = seen & (length > LEAST)
    i, j = np.nonzero(strong)
    east = np.stack([-np.sin(azimuth[j]), np.cos(azimuth[j]), np.zeros(len(j))], -1)
    up = np.stack(
        [-np.sin(elevation[i]) * np.cos(azimuth[j]), -np.sin(elevation[i]) * np.sin(azimuth[j]), np.cos(elevation[i])],
        -1,
    )
    gradient = along[strong][:, None] * east + down[strong][:, None] * up
    weights = np.sqrt(length[strong]) * np.cos(elevation[i])  # solid angle; strong edges count more, but not all
    return gradient / np.linalg.norm(gradient, axis=1, keepdims=True), weights


def _cap(radius_rad: float, step_rad: float) -> Floats:
    """Unit directions (K, 3) about a step apart, within a radius of +z, the first of them +z."""
    rings = np.linspace(0, radius_rad, int(np.ceil(radius_rad / step_rad)) + 1)
    counts = [max(1, int(np.ceil(2 * np.pi * np.sin(r) / step_rad))) for r in rings]
    tilt = np.repeat(rings, counts)
    azimuth = np.concatenate([2 * np.pi * np.arange(n) / n for n in counts])
    return np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], -1)


def _upright(zenith: Floats) -> Floats:
    """R_upright_camera (3, 3): the smallest rotation that takes the zenith to +z."""
    axis = np.cross(zenith, [0.0, 0, 1])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + zenith[2]))
