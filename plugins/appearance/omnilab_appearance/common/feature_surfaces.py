"""Surfaces beside the panorama on which local features are found: the camera's own picture, and tiles of the sphere."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Bytes, Floats, Frames, ImageFeatures, Unusable
from omnilab.cameras.base import RayCamera, azimuth_elevation, not_too_steep
from omnilab.errors import DataError
from omnilab.image import panorama_shape, to_gray
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.spherical_features import BORDER, Detect, detector_of, unusable

MARGIN = 24  # pixels around a tile: what lies at its edge is found and described whole
# columns: what is right, down and ahead in each tile, in the camera frame
TILES = [
    np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]]),
    np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]]),
    np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]),
    np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
]


class FeatureSurface(Enum):
    """Where features are found."""

    panorama = "panorama"
    image = "image"  # the camera's own picture: nothing is resampled
    tiles = "tiles"  # the six faces of a cube: perspective pictures of 90 degrees


class _Projection(NamedTuple):
    """How a camera's pictures become those of a surface, and where the pixels of that projection."""

    maps: tuple[Floats, Floats] | None  # (H, W) each, of `cv2.remap`; None: the picture as it is
    valid: Bools  # (H, W): the camera shows it
    directions: Callable[[Floats], Floats]  # unit (F, 3), of pixels (F, 2)


def surface_features(
    frames: Frames, surface: FeatureSurface, detector: Detector, count: int, least: int
) -> list[ImageFeatures | Unusable]:
    """`spherical_features` on another surface, which has the camera's own resolution; DataError if it has no model."""
    import cv2

    camera = frames.camera
    if not isinstance(camera, RayCamera):
        raise DataError(
            f"surface={surface.value} needs a camera model, and a {type(camera).__name__} is none; give panorama"
        )
    projection = _image_projection(camera) if surface is FeatureSurface.image else _tile_projection(camera)
    pictures = to_gray(frames.images)
    if projection.maps is not None:
        u, v = projection.maps
        remapped = [cv2.remap(each, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for each in pictures]
        pictures = np.stack(remapped).astype(np.uint8, copy=False)
    find = detector_of(detector)
    return [_detect(picture, projection, camera, find, count, least) for picture in pictures]


def _detect(
    picture: Bytes, projection: _Projection, camera: RayCamera, detect: Detect, count: int, least: int
) -> ImageFeatures | Unusable:
    if reason := unusable(picture[projection.valid]):
        return Unusable(reason)
    uv, vectors = detect(picture, projection.valid, count)
    directions = projection.directions(uv)
    kept = np.flatnonzero(np.isfinite(directions).all(axis=1))[:count]
    if len(kept) < least:
        return Unusable(f"{len(kept)} features")
    azimuth, elevation = azimuth_elevation(directions[kept])
    low, high = not_too_steep(*camera.elevations_rad)
    azimuth_level = np.stack([np.mod(azimuth, 2 * np.pi), (elevation - low) / (high - low)], -1)
    return ImageFeatures(directions[kept].astype(np.float32), azimuth_level.astype(np.float32), vectors[kept])


@lru_cache(maxsize=8)
def _image_projection(camera: RayCamera) -> _Projection:
    v, u = np.indices((camera.height, camera.width)).astype(float)
    ring, away = camera.circle, np.hypot(u - camera.circle.cx, v - camera.circle.cy)
    on_ring = (ring.radius == 0) | ((away >= ring.inner) & (away <= ring.radius))
    return _Projection(
        None, _eroded(on_ring & _shown(camera.directions(np.stack([u, v], -1)), camera)), camera.directions
    )


@lru_cache(maxsize=8)
def _tile_projection(camera: RayCamera) -> _Projection:
    """The faces side by side: ahead, left, behind, right, down, up, each with a margin."""
    focal = panorama_shape(camera)[1] / (2 * np.pi)
    side = 2 * (int(np.ceil(focal)) + MARGIN)

    def directions(uv: Floats) -> Floats:
        tile = np.clip(((uv[..., 0] + 0.5) // side).astype(int), 0, len(TILES) - 1)
        right, down = uv[..., 0] - tile * side - (side - 1) / 2, uv[..., 1] - (side - 1) / 2
        ray = np.stack([right / focal, down / focal, np.ones_like(right)], -1)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        return np.asarray(np.einsum("...ij,...j->...i", np.array(TILES)[tile], ray))

    v, u = np.indices((side, len(TILES) * side)).astype(float)
    looking = directions(np.stack([u, v], -1))
    at = camera.pixels(looking)
    across, down = (np.abs(np.mod(side_px, side) - (side - 1) / 2) for side_px in (u, v))
    shown = _eroded(_shown(looking, camera) & _framed(at, camera)) & (across <= focal) & (down <= focal)
    maps = np.where(np.isfinite(at), at, -1e4).astype(np.float32)
    return _Projection((np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])), shown, directions)


def _shown(directions: Floats, camera: RayCamera) -> Bools:
    """Which directions (..., 3) have an elevation that the camera's panorama shows."""
    low, high = not_too_steep(*camera.elevations_rad)
    elevation = azimuth_elevation(directions)[1]
    with np.errstate(invalid="ignore"):
        return np.asarray((elevation >= low) & (elevation <= high))


def _framed(pixels: Floats, camera: RayCamera) -> Bools:
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels > -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1))


def _eroded(valid: Bools) -> Bools:
    import cv2

    return np.asarray(cv2.erode(valid.astype(np.uint8), np.ones((2 * BORDER + 1, 2 * BORDER + 1), np.uint8)) > 0)
