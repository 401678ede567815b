"""Base classes of cameras: each pixel is a ray. Also uncalibrated circles, and panoramas as cameras.

`directions` gives each pixel its unit direction in the camera frame, `pixels` is its inverse; NaN where there is none.
Conventions (azimuth, image axes, frames) are those of `omnilab.api`; a model whose literature has others says so.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from omnilab.api import Circle, Floats
from omnilab.cameras.plausibility import check_frame, check_numbers
from omnilab.errors import ConfigError

STEEPEST_RAD = np.deg2rad(60.0)  # edges of a calibrated panorama: below the camera mostly sees its own carrier


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

    def flipped(self) -> ImageCircle:
        """The circle in the same pictures flipped left to right."""
        return replace(self, circle=replace(self.circle, cx=self.width - 1 - self.circle.cx))


class RayCamera(ABC):
    """A calibrated camera: each pixel sees along a ray, which has a direction and a point where it starts."""

    if TYPE_CHECKING:  # a model has these as fields or as properties

        @property
        def width(self) -> int: ...
        @property
        def height(self) -> int: ...
        @property
        def circle(self) -> Circle: ...

    @property
    @abstractmethod
    def elevations_rad(self) -> tuple[float, float]:
        """The lowest and the highest elevation that the image shows."""

    @abstractmethod
    def directions(self, pixels: Floats) -> Floats:
        """Unit directions (..., 3) in the camera frame that pixels (..., 2) = (u, v) look to; NaN where there is none."""

    @abstractmethod
    def origins(self, pixels: Floats) -> Floats:
        """Points (..., 3) in the camera frame, in metres, where the rays of pixels (..., 2) start."""

    @abstractmethod
    def pixels(self, directions: Floats) -> Floats:
        """Pixels (..., 2) that show directions (..., 3) of any length; NaN for those that the camera does not show."""

    @abstractmethod
    def project(self, points_m: Floats) -> Floats:
        """Pixels (..., 2) that show points (..., 3) in the camera frame; NaN for those that the camera does not show."""

    def flipped(self) -> RayCamera:
        """The camera of the same pictures flipped left to right.

        Where this one looks to (x, y, z), that one looks to (-x, y, z); a camera that looks ahead, to (x, -y, z).
        """
        raise ConfigError(
            f"a {type(self).__name__} has no model of flipped pictures; calibrate it on pictures as they are"
        )

    def unwrap(self, azimuth_rad: Floats, level: Floats) -> Floats:
        """Pixels (..., 2) of a panorama's points; levels are spaced evenly in elevation, at most 60 degrees steep."""
        lowest, highest = not_too_steep(*self.elevations_rad)
        return self.pixels(looking(azimuth_rad, lowest + np.asarray(level) * (highest - lowest)))


class CentralCamera(RayCamera):
    """A camera whose rays all start in one viewpoint, the origin of its frame."""

    def origins(self, pixels: Floats) -> Floats:
        return np.zeros((*np.shape(pixels)[:-1], 3))

    def project(self, points_m: Floats) -> Floats:
        return self.pixels(points_m)


def not_too_steep(lowest_rad: float, highest_rad: float) -> tuple[float, float]:
    """The part of a range of elevations that is at most 60 degrees steep, or all of it if no part is."""
    low, high = max(lowest_rad, -STEEPEST_RAD), min(highest_rad, STEEPEST_RAD)
    return (low, high) if low < high else (lowest_rad, highest_rad)


def looking(azimuth_rad: Floats, elevation_rad: Floats) -> Floats:
    """Unit directions (..., 3) at azimuths and elevations."""
    azimuth, elevation = np.broadcast_arrays(azimuth_rad, elevation_rad)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)


def azimuth_elevation(directions: Floats) -> tuple[Floats, Floats]:
    """Azimuths and elevations (...,) of directions (..., 3) of any length."""
    x, y, z = np.moveaxis(np.asarray(directions, float), -1, 0)
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def polar_pixels(ring: Circle, azimuth_rad: Floats, radius: Floats) -> Floats:
    """Pixels (..., 2) = (u, v) at an azimuth and a radius from the circle's centre."""
    return np.stack([ring.cx + radius * np.cos(azimuth_rad), ring.cy - radius * np.sin(azimuth_rad)], -1)


@dataclass(frozen=True)
class PanoramaCamera(CentralCamera):
    """A panorama over all azimuths. It has no image circle: the radius of `circle` is 0.

    Column 0 looks to azimuth `start_deg` and azimuth grows along the columns, as in `omnilab.image.panorama`. Most
    published panoramas are laid out as a viewer inside sees them: azimuth falls, so they are `clockwise`.
    """

    width: int
    height: int
    start_deg: float = 0.0
    clockwise: bool = False

    def __post_init__(self) -> None:
        check_frame(self.width, self.height)
        check_numbers(self)

    @property
    def circle(self) -> Circle:
        return Circle((self.width - 1) / 2, (self.height - 1) / 2, 0.0)

    def directions(self, pixels: Floats) -> Floats:
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        share = (v + 0.5) / self.height
        elevation = np.where((share >= -1e-9) & (share <= 1 + 1e-9), self._elevation(share), np.nan)
        return looking(np.deg2rad(self.start_deg) + u * self._radians_per_column, elevation)

    def pixels(self, directions: Floats) -> Floats:
        azimuth, elevation = azimuth_elevation(directions)
        share = self._share(elevation)
        columns = (azimuth - np.deg2rad(self.start_deg)) / self._radians_per_column
        u = np.mod(columns + 0.5, self.width) - 0.5
        uv = np.stack([u, share * self.height - 0.5], -1)
        return np.where(((share >= -1e-9) & (share <= 1 + 1e-9))[..., None], uv, np.nan)

    def flipped(self) -> Self:
        degrees_per_column = float(np.rad2deg(self._radians_per_column))
        return replace(self, start_deg=180.0 - self.start_deg + degrees_per_column)

    @property
    def _radians_per_column(self) -> float:
        return (-2 if self.clockwise else 2) * np.pi / self.width

    @abstractmethod
    def _elevation(self, share: Floats) -> Floats:
        """Elevations at shares of the height, from the top edge (0) to the bottom edge (1)."""

    @abstractmethod
    def _share(self, elevation_rad: Floats) -> Floats:
        """The inverse of `_elevation`."""


@dataclass(frozen=True)
class EquirectangularCamera(PanoramaCamera):
    """The sphere, or a range of its elevations: rows are spaced evenly in elevation, the highest at the top edge."""

    lowest_deg: float = -90.0  # elevation of the bottom edge
    highest_deg: float = 90.0  # elevation of the top edge

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -90 <= self.lowest_deg < self.highest_deg <= 90:
            raise ConfigError(
                f"a sphere has no elevations from {self.lowest_deg:g} to {self.highest_deg:g} degrees;"
                " give lowest_deg below highest_deg, both from -90 to 90"
            )

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return float(np.deg2rad(self.lowest_deg)), float(np.deg2rad(self.highest_deg))

    def _elevation(self, share: Floats) -> Floats:
        bottom, top = self.elevations_rad
        return top - share * (top - bottom)

    def _share(self, elevation_rad: Floats) -> Floats:
        bottom, top = self.elevations_rad
        return (top - elevation_rad) / (top - bottom)


@dataclass(frozen=True)
class CylindricalCamera(PanoramaCamera):
    """A picture on an upright cylinder: rows are spaced evenly in the tangent of the elevation."""

    lowest_deg: float = -45.0  # elevation of the bottom edge
    highest_deg: float = 45.0  # elevation of the top edge

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -90 < self.lowest_deg < self.highest_deg < 90:
            raise ConfigError(
                f"a cylinder from {self.lowest_deg:g} to {self.highest_deg:g} degrees does not exist;"
                " give lowest_deg below highest_deg, both between -90 and 90"
            )

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return float(np.deg2rad(self.lowest_deg)), float(np.deg2rad(self.highest_deg))

    def _elevation(self, share: Floats) -> Floats:
        bottom, top = np.tan(self.elevations_rad)
        return np.asarray(np.arctan(top - share * (top - bottom)))

    def _share(self, elevation_rad: Floats) -> Floats:
        bottom, top = np.tan(self.elevations_rad)
        return np.asarray((top - np.tan(elevation_rad)) / (top - bottom))
