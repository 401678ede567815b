"""Where omnidirectional cameras look: central camera models, and the pictures that descriptors are given.

Conventions (azimuth, image axes, frames) are those of `omnilab.api`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Camera, Circle
from omnilab.errors import ConfigError, DataError

Floats = npt.NDArray[np.floating[Any]]

PANORAMA_SHAPE = (128, 512)  # rows, columns: about the resolution that a 250 x 250 mirror image has at mid radius
LOWEST_RAD = np.deg2rad(-60.0)  # bottom of a calibrated panorama: below it the camera mostly sees its own carrier


@dataclass(frozen=True)
class ImageCircle:
    """An uncalibrated omnidirectional image: only the ring that shows the world is known."""

    width: int
    height: int
    circle: Circle
    sky_inside: bool = False  # the horizon is crossed inwards (a camera above its mirror)

    def unwrap(self, azimuth_rad: Floats, level: Floats) -> Floats:
        """Pixels (..., 2) of a panorama's points; levels are spaced evenly in radius."""
        ring = self.circle
        outward = 1 - np.asarray(level) if self.sky_inside else np.asarray(level)
        return polar_pixels(ring, azimuth_rad, ring.inner + outward * (ring.radius - ring.inner))


@dataclass(frozen=True)
class HyperbolicMirror:
    """A perspective camera that looks up into a hyperbolic mirror (Berenguer, thesis, eq. 3.1-3.6).

    The mirror is the upper sheet of (x^2 + y^2) / a^2 - z^2 / b^2 = -1; the camera's focus and the effective viewpoint
    are its foci F = (0, 0, -c) and F' = (0, 0, +c), c^2 = a^2 + b^2. Lengths are in millimetres, and only their ratios
    matter. `crop` is the share of the mirror's diameter that the square image shows: 1.0 all of it, 0.5 as the thesis.
    """

    size: int = 250
    crop: float = 0.5
    a_mm: float = 40.0
    b_mm: float = 160.0
    rim_mm: float = 41.0  # from the mirror's apex up to its rim

    def __post_init__(self) -> None:
        if self.size < 8:
            raise ConfigError(f"a mirror image of {self.size} pixels is too small; give a size of at least 8")
        if not 0 < self.crop <= 1:
            raise ConfigError(f"crop={self.crop} is not a share of the mirror; give a number above 0 and up to 1")
        if min(self.a_mm, self.b_mm, self.rim_mm) <= 0:
            raise ConfigError(
                f"a mirror with a={self.a_mm}, b={self.b_mm}, rim={self.rim_mm} mm has no hyperbola; give lengths above 0"
            )

    @property
    def width(self) -> int:
        return self.size

    @property
    def height(self) -> int:
        return self.size

    @property
    def center(self) -> float:
        """The axis meets the image at (center, center), in pixels."""
        return (self.size - 1) / 2

    @property
    def circle(self) -> Circle:
        """The rim, in pixels. With `crop` below 1 it lies outside the image."""
        return Circle(self.center, self.center, self.size / 2 / self.crop)

    @property
    def c_mm(self) -> float:
        """Half the distance between the foci."""
        return float(np.hypot(self.a_mm, self.b_mm))

    @property
    def pixels_per_slope(self) -> float:
        """Radius in the image over the tangent of the angle to the axis at the camera."""
        rim_radius = self.a_mm * np.sqrt((self.b_mm + self.rim_mm) ** 2 / self.b_mm**2 - 1)
        return self.circle.radius * float((self.b_mm + self.rim_mm + self.c_mm) / rim_radius)

    def directions(self, pixels: Floats) -> Floats:
        """Unit directions (..., 3) in the camera frame that pixels (..., 2) = (u, v) look to; NaN beyond the rim."""
        x = (np.asarray(pixels)[..., 0] - self.center) / self.pixels_per_slope
        y = (self.center - np.asarray(pixels)[..., 1]) / self.pixels_per_slope
        slope2 = x**2 + y**2
        # the ray F + t (x, y, 1) meets the upper sheet at
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.c_mm + self.b_mm * np.sqrt(1 + slope2)) / (1 - slope2 * (self.b_mm / self.a_mm) ** 2)
            Q = np.stack([t * x, t * y, t - 2 * self.c_mm], -1)  # as seen from F'
            Q = Q / np.linalg.norm(Q, axis=-1, keepdims=True)
        beyond = slope2 * self.pixels_per_slope**2 > (self.circle.radius + 1e-9) ** 2
        return np.where(beyond[..., None], np.nan, Q)

    def pixels(self, directions: Floats) -> Floats:
        """Pixels (..., 2) that show directions (..., 3); NaN for those that the mirror does not show."""
        d = np.asarray(directions, float)
        azimuth = np.arctan2(d[..., 1], d[..., 0])
        return polar_pixels(self.circle, azimuth, self._radius(np.arctan2(d[..., 2], np.hypot(d[..., 0], d[..., 1]))))

    def _radius(self, elevation_rad: Floats) -> Floats:
        """Radius in the image of an elevation above the horizon; NaN beyond the rim."""
        sin, cos = np.sin(elevation_rad), np.cos(elevation_rad)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = self.a_mm**2 / (self.b_mm - self.c_mm * sin)  # |QF| - |QF'| = 2b
            radius = self.pixels_per_slope * t * cos / (2 * self.c_mm + t * sin)
        return np.where((t > 0) & (radius <= self.circle.radius + 1e-9), radius, np.nan)

    @property
    def highest_rad(self) -> float:
        """Elevation at the edge of the largest circle that the image shows whole."""
        edge = self.directions(np.array([self.center + self.size / 2, self.center]))
        return float(np.arcsin(edge[2]))

    def unwrap(self, azimuth_rad: Floats, level: Floats) -> Floats:
        """Pixels (..., 2) of a panorama's points; levels are spaced evenly in elevation."""
        elevation = LOWEST_RAD + np.asarray(level) * (self.highest_rad - LOWEST_RAD)
        return polar_pixels(self.circle, azimuth_rad, self._radius(elevation))


def polar_pixels(ring: Circle, azimuth_rad: Floats, radius: Floats) -> Floats:
    """Pixels (..., 2) = (u, v) at an azimuth and a radius from the circle's centre."""
    return np.stack([ring.cx + radius * np.cos(azimuth_rad), ring.cy - radius * np.sin(azimuth_rad)], -1)


def to_gray(images: Bytes) -> Bytes:
    """Grey images (N, H, W) of grey or RGB ones (N, H, W, 3): Rec. 601 luma, as OpenCV computes it."""
    if images.ndim == 3:
        return images
    import cv2

    n, h, w, _ = images.shape
    return np.asarray(cv2.cvtColor(images.reshape(n * h, w, 3), cv2.COLOR_RGB2GRAY), np.uint8).reshape(n, h, w)


def to_color(images: Bytes) -> Bytes:
    """RGB images (N, H, W, 3) of RGB or grey ones (N, H, W)."""
    return images if images.ndim == 4 else np.repeat(images[..., None], 3, axis=-1)


def mirror_view(images: Bytes, camera: Camera) -> Bytes:
    """The square around the image circle, (N, S, S[, 3]); what lies beyond the frame is left out on both sides."""
    ring = camera.circle
    half = min(ring.radius, ring.cx + 0.5, camera.width - 0.5 - ring.cx, ring.cy + 0.5, camera.height - 0.5 - ring.cy)
    side = int(2 * half + 1e-6)
    if side < 8:
        raise DataError(
            f"the image circle at ({ring.cx:.0f}, {ring.cy:.0f}) with radius {ring.radius:.0f} leaves {max(side, 0)} pixels"
            f" of a {camera.width} x {camera.height} image; give a centre inside the image"
        )
    left, top = round(ring.cx + 0.5 - side / 2), round(ring.cy + 0.5 - side / 2)
    return images[:, top : top + side, left : left + side]


def panorama(images: Bytes, camera: Camera, shape: tuple[int, int] = PANORAMA_SHAPE) -> Bytes:
    """Panoramas (N, rows, columns[, 3]): up is up, column j looks to azimuth 2 pi j / columns (counter-clockwise)."""
    import cv2

    map_u, map_v = _panorama_map(camera, shape)  # type: ignore[arg-type]  # cameras are frozen dataclasses
    unwrapped = [cv2.remap(image, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for image in images]
    return np.stack(unwrapped).astype(np.uint8, copy=False)


@lru_cache(maxsize=8)
def _panorama_map(camera: Camera, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    rows, columns = shape
    azimuth = 2 * np.pi * np.arange(columns) / columns
    level = 1 - (np.arange(rows) + 0.5) / rows
    uv = camera.unwrap(*np.broadcast_arrays(azimuth[None, :], level[:, None])).astype(np.float32)
    return np.ascontiguousarray(uv[..., 0]), np.ascontiguousarray(uv[..., 1])


def view_of(images: Bytes, camera: Camera, view: str, color: bool) -> Bytes:
    """The pictures that a descriptor asks for with its class attributes `view` and `color`."""
    images = to_color(images) if color else to_gray(images)
    if view == "mirror":
        return mirror_view(images, camera)
    if view == "panorama":
        return panorama(images, camera)
    raise ConfigError(f"view={view!r} is not known; a descriptor's view is 'mirror' or 'panorama'")


def encode(pixels: Bytes, format: str = "jpeg") -> bytes:
    """A picture (H, W) or RGB (H, W, 3) as JPEG (quality 85) or PNG."""
    import cv2

    bgr = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    options = [cv2.IMWRITE_JPEG_QUALITY, 85] if format == "jpeg" else []
    good, data = cv2.imencode(f".{format}", np.ascontiguousarray(bgr), options)
    if not good:
        raise DataError(f"a picture of shape {pixels.shape} cannot be written as {format}; use jpeg or png")
    return bytes(data)
