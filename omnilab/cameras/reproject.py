"""Pictures of one camera as another would have taken them from the same viewpoint.

Conventions (azimuth, image axes, frames) are those of `omnilab.api`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.cameras.base import PanoramaCamera, RayCamera
from omnilab.cameras.lenses import PinholeCamera
from omnilab.errors import ConfigError, DataError

LARGEST_SIDE = 32764  # pixels; OpenCV's remap takes 32766, and a panorama gets two columns more
NOWHERE = -1e4  # pixel coordinate of what the source does not show


def reproject(
    images: Bytes, source: RayCamera, target: RayCamera, R_source_target: Floats | None = None, samples: int = 1
) -> Bytes:
    """Images (N, H, W[, 3]) of the camera `source` as `target` would have taken them, (N, H', W'[, 3]).

    `R_source_target` (3, 3) takes directions of the target's frame to the source's: it says where the target looks.
    Each pixel is the mean of `samples` = n x n directions in it, bilinear in the source; give 4, 9 or more where the
    target is the coarser picture. What the source does not show is black. Exact for cameras with one viewpoint; with
    others it holds for what is far away.
    """
    _check(images, source, target, samples)
    R = np.eye(3) if R_source_target is None else np.asarray(R_source_target, float)
    maps = _maps(source, target, R.tobytes(), samples)
    if isinstance(source, PanoramaCamera):  # the first column is the last one's neighbour
        images = np.concatenate([images[:, :, -1:], images, images[:, :, :1]], 2)
    return np.stack([_mean(image, maps) for image in images])


def birds_eye(size_px: int, metres_per_px: float, height_m: float) -> PinholeCamera:
    """The bird's-eye view of the floor from `height_m` above it, `size_px` squared: image right is +x, image up +y.

    It is the pinhole camera that looks down. A plane square to its axis is imaged at one scale, so of the floor this
    picture is the orthographic one (Berenguer, thesis, 3.2); what stands on the floor leans outward, as no single
    image can tell how high it is.
    """
    for name, value in {"metres_per_px": metres_per_px, "height_m": height_m}.items():
        if not 0 < value < np.inf:
            raise ConfigError(f"{name}={value} makes no bird's-eye view; give metres above 0")
    center = (size_px - 1) / 2
    focal_px = height_m / metres_per_px
    return PinholeCamera(width=size_px, height=size_px, cx=center, cy=center, looks="down", focal_px=focal_px)


def _check(images: Bytes, source: RayCamera, target: RayCamera, samples: int) -> None:
    if images.ndim not in {3, 4} or images.shape[1:3] != (source.height, source.width) or len(images) == 0:
        raise DataError(
            f"images of shape {images.shape} are not those of a camera with {source.width} x {source.height} pixels;"
            f" give (N, {source.height}, {source.width}) or (N, {source.height}, {source.width}, 3)"
        )
    if samples < 1 or int(np.sqrt(samples)) ** 2 != samples:
        raise ConfigError(f"samples={samples} do not fill a square; give 1, 4, 9 or another square")
    largest = max(source.width, source.height, target.width, target.height)
    if largest > LARGEST_SIDE:
        raise ConfigError(f"a picture of {largest} pixels a side is too large; give at most {LARGEST_SIDE}")


@lru_cache(maxsize=4)
def _maps(source: RayCamera, target: RayCamera, R: bytes, samples: int) -> tuple[tuple[Floats, Floats], ...]:
    """For each sample of a pixel: u and v (H', W') in the source, `NOWHERE` where it does not show them."""
    n = int(np.sqrt(samples))
    offset = (np.arange(n) + 0.5) / n - 0.5
    v, u = np.indices((target.height, target.width))
    R_source_target = np.frombuffer(R).reshape(3, 3)
    maps = []
    for du, dv in np.stack(np.meshgrid(offset, offset), -1).reshape(-1, 2):
        directions = target.directions(np.stack([u + du, v + dv], -1))
        maps.append(_seen(source, source.pixels(directions @ R_source_target.T)))
    return tuple(maps)


def _seen(source: RayCamera, pixels: Floats) -> tuple[Floats, Floats]:
    """u and v of pixels (..., 2), `NOWHERE` beyond the frame; those of a panorama count from the column before it."""
    with np.errstate(invalid="ignore"):  # NaN: no pixel
        inside = np.all((pixels >= -0.5) & (pixels <= np.array([source.width, source.height]) - 0.5), axis=-1)
    u, v = np.where(inside, np.moveaxis(pixels, -1, 0), NOWHERE).astype(np.float32)
    return (u + np.float32(1) if isinstance(source, PanoramaCamera) else u), v


def _mean(image: Bytes, maps: tuple[tuple[Floats, Floats], ...]) -> Bytes:
    """The mean of the samples that the image (H, W[, 3]) shows; 0 where there is none."""
    import cv2

    total = np.zeros((*maps[0][0].shape, *image.shape[2:]), np.float32)
    count = np.zeros(maps[0][0].shape, np.float32)
    for u, v in maps:
        seen = (v != NOWHERE).astype(np.uint8)
        sampled = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        cv2.accumulate(sampled, total, seen)
        count += seen
    count = np.maximum(count, 1)
    return np.asarray(np.rint(total / (count if image.ndim == 2 else count[..., None])), np.uint8)
