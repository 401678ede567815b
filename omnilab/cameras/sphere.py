"""The whole sphere around a camera as a picture, at no finer resolution than the camera's own."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Bytes, Camera
from omnilab.cameras.base import EquirectangularCamera, RayCamera
from omnilab.cameras.reproject import reproject
from omnilab.errors import DataError

MOST_ROWS = 256  # of a sphere: 0.7 degrees each
FINEST = 4  # samples of a pixel along each side: 16 in all


def sphere(images: Bytes, camera: Camera) -> Bytes:
    """Spheres (N, H, 2 H[, 3]): row i looks to elevation 90 - 180 (i + 1/2) / H degrees, column j to azimuth 180 j / H.

    What the camera does not show is black, and black is taken for not shown, as `reproject` and the disturbance `tilt`
    leave it. H is 256, or less where the camera resolves less.
    """
    if not isinstance(camera, RayCamera):
        raise DataError(
            f"a {type(camera).__name__} does not know where its pixels look, and a sphere needs that; give the images a"
            " calibration, or choose a descriptor whose view is 'mirror' or 'panorama'"
        )
    rows = sphere_rows(camera)
    target = EquirectangularCamera(2 * rows, rows)
    samples = samples_of(camera, target)
    seen = reproject(_shown(camera)[None], camera, target, samples=samples)[0] == 255
    found = reproject(images, camera, target, samples=samples)
    return np.asarray(found * (seen if images.ndim == 3 else seen[..., None]), np.uint8)


@lru_cache(maxsize=16)
def _shown(camera: RayCamera) -> Bytes:
    """255 (H, W) where a pixel shows the world: it has a direction, and is in the image circle if there is one."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    ring, away = camera.circle, np.hypot(u - camera.circle.cx, v - camera.circle.cy)
    within = (ring.radius == 0) | ((away >= ring.inner) & (away <= ring.radius))
    return np.where(within & np.isfinite(camera.directions(np.stack([u, v], -1))).all(-1), 255, 0).astype(np.uint8)


@lru_cache(maxsize=16)
def sphere_rows(camera: RayCamera) -> int:
    """How many rows, an even number, a sphere has whose pixels are no smaller than the camera's; 256 at most."""
    return int(min(MOST_ROWS, 2 * max(4, round(np.pi / resolution_rad(camera) / 2))))


@lru_cache(maxsize=16)
def samples_of(source: RayCamera, target: RayCamera) -> int:
    """How many samples a pixel of the target takes of the source's picture: as many as it has pixels there, 16 at most."""
    finer = resolution_rad(target) / resolution_rad(source)
    return int(np.clip(np.ceil(finer - 0.1), 1, FINEST)) ** 2


@lru_cache(maxsize=16)
def resolution_rad(camera: RayCamera) -> float:
    """The angle between neighbouring pixels, downwards or across, whichever is coarser: its median over the picture."""
    v, u = (np.linspace(0, side - 2, min(side - 1, 48)).round() for side in (camera.height, camera.width))
    at = np.stack(np.meshgrid(u, v), -1)
    here = camera.directions(at)
    # the sine of small angles by the cross product: a cosine near 1 is rounding
    steps = [np.linalg.norm(np.cross(here, camera.directions(at + step)), axis=-1) for step in ([1, 0], [0, 1])]
    return float(np.nanmedian(np.fmax(*steps)))
