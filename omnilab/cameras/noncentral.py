"""Mirrors without a single viewpoint: each pixel sees along a ray that starts where it meets the mirror.

A perspective camera below looks up along +z at a convex mirror of revolution whose apex is the origin of the camera
frame: its focus is at (0, 0, -distance). The rest is that of `omnilab.cameras.mirrors`. All happens in the plane through the
axis and the pixel, with r away from the axis: slope = r / (z + distance) is the tangent of the camera's ray to the axis.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.base import azimuth_elevation, looking, polar_pixels
from omnilab.cameras.mirrors import MirrorCamera
from omnilab.errors import ConfigError

HALVINGS = 44  # of the rim's radius, when a pixel is sought: below 1e-9 pixels


@dataclass(frozen=True)
class NonCentralMirror(MirrorCamera):
    """A convex mirror of revolution z(r) from its apex up to its rim. `crop` is that of `HyperbolicMirror`, here 1.0."""

    crop: float = 1.0
    distance_mm: float = 100.0  # from the camera's focus up to the mirror's apex
    rim_radius_mm: float = 35.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0 < self.distance_mm < np.inf and 0 < self.rim_radius_mm < np.inf):
            raise ConfigError(
                f"distance_mm={self.distance_mm:g} and rim_radius_mm={self.rim_radius_mm:g} are no mirror above a camera;"
                " give lengths above 0"
            )

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return float(self._elevation(np.zeros(()))), self.highest_rad

    @property
    def pixels_per_slope(self) -> float:
        """Radius in the image over the slope of the camera's ray."""
        return self.circle.radius / self._rim_slope

    def origins(self, pixels: Floats) -> Floats:
        x = np.asarray(pixels, float)[..., 0] - self.circle.cx
        y = self.circle.cy - np.asarray(pixels, float)[..., 1]
        r, z = self._meets(np.hypot(x, y) / self.pixels_per_slope)
        azimuth = np.arctan2(y, x)
        points_mm = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], -1)
        return np.where(self._beyond(x, y)[..., None], np.nan, points_mm / 1000)

    def project(self, points_m: Floats) -> Floats:
        points_mm = np.asarray(points_m, float) * 1000
        azimuth, _ = azimuth_elevation(points_mm)
        r, z = np.hypot(points_mm[..., 0], points_mm[..., 1]), points_mm[..., 2]
        radius = self._sought(lambda at_r, at_z: np.arctan2(z - at_z, r - at_r), np.shape(r))
        in_front = (r > self.rim_radius_mm) | (z < self._height(np.minimum(r, self.rim_radius_mm)))
        return polar_pixels(self.circle, azimuth, np.where(in_front, radius, np.nan))

    def _directions(self, x: Floats, y: Floats) -> Floats:
        return looking(np.arctan2(y, x), self._elevation(np.hypot(x, y) / self.pixels_per_slope))

    def _radius(self, elevation_rad: Floats) -> Floats:
        return self._sought(lambda _r, _z: elevation_rad, np.shape(elevation_rad))

    def _sought(self, wanted: Callable[[Floats, Floats], Floats], shape: tuple[int, ...]) -> Floats:
        """Pixels from the axis at which the ray's elevation is the one `wanted` at the point (r, z) it starts from."""
        low, high = np.zeros(shape), np.full(shape, self._rim_slope)

        def too_high(slope: Floats) -> Floats:
            return self._elevation(slope) - wanted(*self._meets(slope))

        shown = (too_high(low) <= 1e-12) & (too_high(high) >= -1e-12)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            beyond = too_high(middle) > 0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return np.where(shown, self.pixels_per_slope * (low + high) / 2, np.nan)

    def _elevation(self, slope: Floats) -> Floats:
        """Elevations that rays leave the mirror at: the camera's ray, reflected at the tangent."""
        steepness = np.arctan2(1, self._rise(*self._meets(slope)))  # of the tangent, from the axis
        return np.asarray(np.pi / 2 - 2 * steepness + np.arctan(slope))

    @property
    def _rim_slope(self) -> float:
        return self.rim_radius_mm / (float(self._height(np.asarray(self.rim_radius_mm))) + self.distance_mm)

    @abstractmethod
    def _meets(self, slope: Floats) -> tuple[Floats, Floats]:
        """Where (r, z) the camera's rays meet the mirror, in millimetres."""

    @abstractmethod
    def _height(self, r: Floats) -> Floats:
        """z(r) in millimetres."""

    @abstractmethod
    def _rise(self, r: Floats, z: Floats) -> Floats:
        """dz/dr at points of the mirror."""


@dataclass(frozen=True)
class ConicMirror(NonCentralMirror):
    """A mirror r^2 = 2 R z - K z^2 with the radius of curvature R at its apex; K is 1 plus the conic constant."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rim_radius_mm >= self._seen_radius:
            raise ConfigError(
                f"from {self.distance_mm:g} mm the camera sees this mirror up to a radius of {self._seen_radius:.1f} mm, so"
                f" that a rim of {self.rim_radius_mm:g} mm is hidden; give a smaller rim_radius_mm"
            )

    @property
    @abstractmethod
    def _curvature_mm(self) -> float:
        """R."""

    @property
    @abstractmethod
    def _shape(self) -> float:
        """K: 1 for a sphere, above 0 for an ellipse, 0 for a parabola, below 0 for a hyperbola."""

    @property
    def _seen_radius(self) -> float:
        """Where the camera's rays touch the mirror: on the polar of its focus."""
        R, K, D = self._curvature_mm, self._shape, self.distance_mm
        if R + K * D <= 0:
            return np.inf
        z = R * D / (R + K * D)
        return float(np.sqrt(2 * R * z - K * z**2))

    def _meets(self, slope: Floats) -> tuple[Floats, Floats]:
        across2 = (slope * self.distance_mm) ** 2
        half = self._curvature_mm - slope**2 * self.distance_mm
        root = np.sqrt(np.maximum(half**2 - (self._shape + slope**2) * across2, 0))
        z = across2 / (half + root)
        return slope * (z + self.distance_mm), z

    def _height(self, r: Floats) -> Floats:
        R = self._curvature_mm
        return np.asarray(r**2 / (R + np.sqrt(R**2 - self._shape * r**2)))

    def _rise(self, r: Floats, z: Floats) -> Floats:
        return r / (self._curvature_mm - self._shape * z)


@dataclass(frozen=True)
class SphericalMirror(ConicMirror):
    """A perspective camera that looks up at a ball. By default it sees from straight down to +48 degrees."""

    radius_mm: float = 40.0

    def __post_init__(self) -> None:
        if not 0 < self.radius_mm < np.inf:
            raise ConfigError(f"radius_mm={self.radius_mm:g} is no ball; give a length above 0")
        super().__post_init__()

    @property
    def _curvature_mm(self) -> float:
        return self.radius_mm

    @property
    def _shape(self) -> float:
        return 1.0


@dataclass(frozen=True)
class EllipticMirror(ConicMirror):
    """A perspective camera that looks up at an ellipsoid with the semi-axes a across and b along its axis.

    By default it sees from straight down to +58 degrees.
    """

    a_mm: float = 40.0
    b_mm: float = 50.0

    def __post_init__(self) -> None:
        if not (0 < self.a_mm < np.inf and 0 < self.b_mm < np.inf):
            raise ConfigError(f"a mirror with a={self.a_mm:g}, b={self.b_mm:g} mm has no ellipse; give lengths above 0")
        super().__post_init__()

    @property
    def _curvature_mm(self) -> float:
        return self.a_mm**2 / self.b_mm

    @property
    def _shape(self) -> float:
        return (self.a_mm / self.b_mm) ** 2


@dataclass(frozen=True)
class ConicalMirror(NonCentralMirror):
    """A perspective camera that looks up at a cone, tip down.

    A ray at the angle t to the axis leaves at the elevation 90 - 2 half_angle_deg + t degrees: by default the image
    reaches from -20 degrees in its middle to +16 degrees, and shows nothing below.
    """

    distance_mm: float = 20.0
    rim_radius_mm: float = 30.0
    half_angle_deg: float = 55.0  # between the axis and the mirror

    def __post_init__(self) -> None:
        if not 0 < self.half_angle_deg < 90:
            raise ConfigError(f"half_angle_deg={self.half_angle_deg:g} is no cone; give degrees between 0 and 90")
        super().__post_init__()

    @property
    def _steepness(self) -> float:
        return float(1 / np.tan(np.deg2rad(self.half_angle_deg)))

    def _meets(self, slope: Floats) -> tuple[Floats, Floats]:
        with np.errstate(divide="ignore", invalid="ignore"):  # beyond the rim rays may miss the cone
            r = slope * self.distance_mm / (1 - slope * self._steepness)
        return r, r * self._steepness

    def _height(self, r: Floats) -> Floats:
        return r * self._steepness

    def _rise(self, r: Floats, z: Floats) -> Floats:  # noqa: ARG002  the same everywhere
        return np.full(np.shape(r), self._steepness)
