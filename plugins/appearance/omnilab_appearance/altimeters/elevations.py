"""Resampling of omnidirectional images to rows of constant elevation."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Bytes, CalibratedCamera, Camera, Floats
from omnilab.image import goes_around, wrapped

COLUMNS = 512  # samples of a row
MARGIN = 64  # columns of the other end beside a panorama, more than the blur reaches
SMOOTHED = 0.7  # standard deviation of the blur before images are sampled, in pixels or in rows, whichever is larger


class Rows(NamedTuple):
    """Pixels of R rows of constant elevation in a camera's images."""

    uv: Floats  # (R, COLUMNS, 2) float32, pixels; column j is at azimuth 2 pi j / COLUMNS
    valid: Bools  # (R,) rows entirely within the frame
    weight: Floats  # (R,) pixels of a row, relative to the longest; of a panorama its length on the sphere
    blur_px: float  # against aliasing
    camera: Camera

    def sample(self, image: Bytes) -> Floats:
        """The rows (R, COLUMNS) float32 of an image (H, W)."""
        import cv2

        image = wrapped(image[None], self.camera, MARGIN)[0]
        smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), self.blur_px)
        return np.asarray(
            cv2.remap(smooth, self.uv[..., 0], self.uv[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        )


@lru_cache(maxsize=8)
def rows_of(camera: Camera, count: int, lowest_deg: float, highest_deg: float, horizon: float) -> Rows:
    """`count` rows between two elevations. A camera without a calibration shows elevations evenly in radius, and the
    horizon at a share `horizon` of its ring, from the edge that shows the ground to the other."""
    elevation = np.deg2rad(lowest_deg + (np.arange(count) + 0.5) / count * (highest_deg - lowest_deg))
    azimuth, elevation = np.meshgrid(2 * np.pi * np.arange(COLUMNS) / COLUMNS, elevation)
    if isinstance(camera, CalibratedCamera):
        level = np.cos(elevation)
        uv = camera.pixels(np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1))
    else:
        uv = camera.unwrap(azimuth, horizon * (1 + elevation / (np.pi / 2)))
    frame = np.array([camera.width, camera.height])
    around = goes_around(camera)
    with np.errstate(invalid="ignore"):
        within = (uv > -0.5) & (uv < frame - 0.5)
        within[..., 0] |= around
        inside = within.all(-1)
        inside &= np.hypot(uv[..., 0] - camera.circle.cx, uv[..., 1] - camera.circle.cy) >= camera.circle.inner
    valid = inside.all(axis=1)
    # rows of a panorama have as many pixels, however short they are
    along = np.cos(elevation[:, 0]) if around else np.linalg.norm(np.diff(uv, axis=1), axis=-1).mean(axis=1)
    across = np.linalg.norm(np.diff(uv, axis=0), axis=-1)[valid[1:] & valid[:-1]]
    spacing = float(np.median(across)) if across.size else 1.0
    weight = np.where(valid, along, 0) / max(float(along[valid].max(initial=0)), 1e-9)
    uv = np.nan_to_num(uv + np.array([MARGIN * around, 0]), nan=-1.0).astype(np.float32)
    return Rows(uv, valid, weight, SMOOTHED * max(1.0, spacing), camera)
