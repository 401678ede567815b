"""Images before they are described or logged: grey levels, views, panoramas, JPEG. Imports no camera model.

Conventions (azimuth, image axes, frames) are those of `omnilab.api`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bytes, Camera, Floats
from omnilab.errors import ConfigError, DataError
from omnilab.limits import check_work

if TYPE_CHECKING:
    from omnilab.cameras import RayCamera

PANORAMA_SHAPE = (128, 512)  # rows, columns: about the resolution that a 250 x 250 mirror image has at mid radius
LARGEST_SIDE = 32764  # pixels, of what OpenCV remaps
MAP_BYTES = 64.0  # of a panorama's pixel, while it is looked up where the camera shows it
UNSEEN = -1e4  # the pixel of a direction that has none
SEAM = 1  # columns of the other end beside a picture that goes all the way around, for what lies between both ends


def to_gray(images: Bytes) -> Bytes:
    """Grey images (N, H, W) of grey or RGB ones (N, H, W, 3): Rec. 601 luma, as OpenCV computes it."""
    if images.ndim == 3:
        return images
    import cv2

    n, h, w, _ = images.shape
    return np.asarray(cv2.cvtColor(images.reshape(n * h, w, 3), cv2.COLOR_RGB2GRAY), np.uint8).reshape(n, h, w)


def to_color(images: Bytes) -> Bytes:
    """RGB images (N, H, W, 3) of RGB or grey ones (N, H, W)."""
    if images.ndim == 4:
        return images
    if images.size == 0:  # which OpenCV refuses
        return np.empty((*images.shape, 3), images.dtype)
    import cv2

    n, h, w = images.shape
    return np.asarray(cv2.cvtColor(images.reshape(n * h, w), cv2.COLOR_GRAY2RGB), np.uint8).reshape(n, h, w, 3)


def goes_around(camera: Camera) -> bool:
    """Whether the camera's pictures are panoramas: the last column is the neighbour of the first."""
    from omnilab.cameras.base import PanoramaCamera

    return isinstance(camera, PanoramaCamera)


def wrapped(images: Bytes, camera: Camera, columns: int) -> Bytes:
    """Panoramas with as many columns of the other end on either side; images of other cameras as they are."""
    if not goes_around(camera):
        return images
    return np.take(images, np.arange(-columns, images.shape[2] + columns), axis=2, mode="wrap")


def mirror_view(images: Bytes, camera: Camera) -> Bytes:
    """The square around the image circle, (N, S, S[, 3]); what lies beyond the frame is left out on both sides.

    That is the camera's own picture, of a mirror or of a lens that looks up or down. Panoramas, which have no circle, and
    cameras that look ahead have what the sensor `mirror` would have taken in their place; what they do not show is black.
    """
    ring = camera.circle
    if ring.radius == 0 or getattr(camera, "looks", "") == "ahead":
        return _through_mirror(images, camera)
    half = min(ring.radius, ring.cx + 0.5, camera.width - 0.5 - ring.cx, ring.cy + 0.5, camera.height - 0.5 - ring.cy)
    side = int(2 * half + 1e-6)
    if side < 8:
        raise DataError(
            f"the image circle at ({ring.cx:.0f}, {ring.cy:.0f}) with radius {ring.radius:.0f} leaves {max(side, 0)} pixels"
            f" of a {camera.width} x {camera.height} image; give a centre inside the image"
        )
    left, top = round(ring.cx + 0.5 - side / 2), round(ring.cy + 0.5 - side / 2)
    return images[:, top : top + side, left : left + side]


def _through_mirror(images: Bytes, camera: Camera) -> Bytes:
    """Images reprojected to the thesis's mirror: half of it, or all of it where they show more of what is above."""
    from omnilab.cameras import THESIS_HALF, THESIS_WHOLE, RayCamera, reproject
    from omnilab.cameras.sphere import samples_of

    if not isinstance(camera, RayCamera):
        raise DataError(
            f"a {type(camera).__name__} has no image circle; use a descriptor whose view is 'panorama' instead of 'mirror'"
        )
    mirror = THESIS_WHOLE if sum(camera.elevations_rad) / 2 > THESIS_HALF.highest_rad else THESIS_HALF
    return reproject(images, camera, mirror, samples=max(4, samples_of(camera, mirror)))


def panorama(images: Bytes, camera: Camera, shape: tuple[int, int] = PANORAMA_SHAPE) -> Bytes:
    """Panoramas (N, rows, columns[, 3]): up is up, column j looks to azimuth 2 pi j / columns (counter-clockwise).

    What the camera does not show is black. `panorama_shape` says at which size it loses nothing.
    """
    import cv2

    map_u, map_v = _panorama_map(camera, shape)  # type: ignore[arg-type]  # cameras are frozen dataclasses
    images = wrapped(images, camera, SEAM)
    unwrapped = [cv2.remap(image, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for image in images]
    pictures = np.stack(unwrapped).astype(np.uint8, copy=False)
    pictures[:, map_u < UNSEEN / 2] = 0
    return pictures


@lru_cache(maxsize=64)
def panorama_shape(camera: Camera) -> tuple[int, int]:
    """Rows and columns of the panorama that has the camera's own resolution, and at least `PANORAMA_SHAPE`.

    Of what the camera shows, a pixel of the panorama is as wide and as high as one of the camera, in the median over
    azimuths and levels.
    """
    step = 1e-4
    azimuth = 2 * np.pi * (np.arange(128) + 0.5)[None, :] / 128
    level = (np.arange(64) + 0.5)[:, None] / 64

    def pixels(da: float, dl: float) -> Floats:
        return np.asarray(camera.unwrap(*np.broadcast_arrays(azimuth + da * step, level + dl * step)), float)

    with np.errstate(invalid="ignore"):  # NaN: no pixel
        shown = ((pixels(0, 0) > -0.5) & (pixels(0, 0) < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1)
    columns = 2 * np.pi * np.linalg.norm(pixels(1, 0) - pixels(-1, 0), axis=-1)[shown] / (2 * step)
    rows = np.linalg.norm(pixels(0, 1) - pixels(0, -1), axis=-1)[shown] / (2 * step)
    known = np.isfinite(rows) & np.isfinite(columns)
    if not known.any():
        return PANORAMA_SHAPE
    own = round(float(np.median(rows[known]))), round(float(np.median(columns[known])))
    return max(own[0], PANORAMA_SHAPE[0]), max(own[1], PANORAMA_SHAPE[1])


@lru_cache(maxsize=8)
def _panorama_map(camera: Camera, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    rows, columns = shape
    if max(shape) > LARGEST_SIDE:
        raise ConfigError(f"a panorama of {rows} x {columns} pixels is too large; give at most {LARGEST_SIDE} a side")
    check_work(f"the {rows} x {columns} pixels of a panorama", "give a smaller one", memory=MAP_BYTES * rows * columns)
    azimuth = 2 * np.pi * np.arange(columns) / columns
    level = 1 - (np.arange(rows) + 0.5) / rows
    uv = camera.unwrap(*np.broadcast_arrays(azimuth[None, :], level[:, None])).astype(np.float32)
    uv[..., 0] += SEAM * goes_around(camera)
    uv[np.isnan(uv).any(-1)] = UNSEEN
    return np.ascontiguousarray(uv[..., 0]), np.ascontiguousarray(uv[..., 1])


def point_cloud(depth_m: Floats, camera: RayCamera, T_world_camera: Floats) -> Floats:
    """World points (H, W, 3) that the pixels of a camera at a pose (4, 4) see at `depth_m` (H, W) along their rays.

    NaN where a pixel sees nothing (Berenguer, thesis, figure 3.13).
    """
    v, u = np.indices(depth_m.shape)
    pixels = np.stack([u, v], -1).astype(float)
    far = np.where(np.isfinite(depth_m), depth_m, np.nan)[..., None]
    points = camera.origins(pixels) + far * camera.directions(pixels)
    return np.asarray(points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3])


def view_of(images: Bytes, camera: Camera, view: str, color: bool) -> Bytes:
    """The pictures that a descriptor asks for with its class attributes `view` and `color`."""
    images = to_color(images) if color else to_gray(images)
    if view == "mirror":
        return mirror_view(images, camera)
    if view == "panorama":
        return panorama(images, camera)
    if view == "sphere":
        from omnilab.cameras.sphere import sphere

        return sphere(images, camera)
    raise ConfigError(f"view={view!r} is not known; a descriptor's view is 'mirror', 'panorama' or 'sphere'")


def encode(pixels: Bytes, format: str = "jpeg") -> bytes:
    """A picture (H, W) or RGB (H, W, 3) as JPEG (quality 85) or PNG."""
    import cv2

    bgr = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    options = [cv2.IMWRITE_JPEG_QUALITY, 85] if format == "jpeg" else []
    good, data = cv2.imencode(f".{format}", np.ascontiguousarray(bgr), options)
    if not good:
        raise DataError(f"a picture of shape {pixels.shape} cannot be written as {format}; use jpeg or png")
    return bytes(data)
