"""Mirrors with one viewpoint, each with a camera below that looks up along the axis, and those that people have built.

`MirrorCamera` is also the base of the mirrors without one, in `omnilab.cameras.noncentral`.

Conventions are those of `omnilab.api`: a camera that looks up takes pictures with azimuth running clockwise, these
models are of the pictures flipped left to right.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from omnilab.api import Circle, Floats
from omnilab.cameras.base import CentralCamera, RayCamera, azimuth_elevation, polar_pixels
from omnilab.cameras.plausibility import check_frame, check_numbers
from omnilab.errors import ConfigError


@dataclass(frozen=True)
class MirrorCamera(RayCamera):
    """A mirror in the middle of the image; `crop` is the share of its diameter that the image's height shows."""

    size: int = 250  # the image's height in pixels, and its width less the margins
    crop: float = 0.5
    margin_px: int = field(default=0, kw_only=True)  # columns on either side of the square

    def __post_init__(self) -> None:
        if self.size < 8:
            raise ConfigError(f"a mirror image of {self.size} pixels is too small; give a size of at least 8")
        if not 0 < self.crop <= 1:
            raise ConfigError(f"crop={self.crop} is not a share of the mirror; give a number above 0 and up to 1")
        if self.margin_px < 0:
            raise ConfigError(f"margin_px={self.margin_px} is no width; give 0 or more columns")
        check_frame(self.width, self.height)
        check_numbers(self)

    @property
    def width(self) -> int:
        return self.size + 2 * self.margin_px

    @property
    def height(self) -> int:
        return self.size

    @property
    def center(self) -> float:
        """The row that the axis meets, in pixels; without margins also the column."""
        return (self.size - 1) / 2

    @property
    def circle(self) -> Circle:
        """The rim, in pixels. With `crop` below 1 it lies outside the image."""
        return Circle(self.center + self.margin_px, self.center, self.size / 2 / self.crop)

    @property
    def highest_rad(self) -> float:
        """Elevation at the edge of the largest circle that the image shows whole."""
        edge = self.directions(np.array([self.circle.cx + self.size / 2, self.circle.cy]))
        return float(np.arcsin(edge[2]))

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return -np.pi / 2, self.highest_rad

    def directions(self, pixels: Floats) -> Floats:
        x = np.asarray(pixels)[..., 0] - self.circle.cx
        y = self.circle.cy - np.asarray(pixels)[..., 1]
        return np.where(self._beyond(x, y)[..., None], np.nan, self._directions(x, y))

    def pixels(self, directions: Floats) -> Floats:
        azimuth, elevation = azimuth_elevation(directions)
        radius = self._radius(elevation)
        shown = np.where(radius <= self.circle.radius + 1e-9, radius, np.nan)
        return polar_pixels(self.circle, azimuth, shown)

    def flipped(self) -> Self:
        """Itself: the mirror is in the middle of the image."""
        return self

    def _beyond(self, x: Floats, y: Floats) -> npt.NDArray[np.bool_]:
        """Which pixels right of and above the axis lie beyond the rim."""
        return np.asarray(x**2 + y**2 > (self.circle.radius + 1e-9) ** 2)

    @abstractmethod
    def _directions(self, x: Floats, y: Floats) -> Floats:
        """Unit directions at pixels right of and above the axis; anything beyond the rim."""

    @abstractmethod
    def _radius(self, elevation_rad: Floats) -> Floats:
        """Pixels from the axis at which an elevation appears; NaN or anything beyond the rim where it does not."""


@dataclass(frozen=True)
class HyperbolicMirror(MirrorCamera, CentralCamera):
    """A perspective camera that looks up into a hyperbolic mirror (Berenguer, thesis, eq. 3.1-3.6).

    The mirror is the upper sheet of (x^2 + y^2) / a^2 - z^2 / b^2 = -1; the camera's focus and the effective viewpoint
    are its foci F = (0, 0, -c) and F' = (0, 0, +c), c^2 = a^2 + b^2. Lengths are in millimetres, and only their ratios
    matter. `crop` is the share of the mirror's diameter that the square image shows: 1.0 all of it, 0.5 as the thesis.
    """

    a_mm: float = 40.0
    b_mm: float = 160.0
    rim_mm: float = 41.0  # from the mirror's apex up to its rim

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.a_mm, self.b_mm, self.rim_mm) <= 0:
            raise ConfigError(
                f"a mirror with a={self.a_mm}, b={self.b_mm}, rim={self.rim_mm} mm has no hyperbola; give lengths above 0"
            )

    @property
    def c_mm(self) -> float:
        """Half the distance between the foci."""
        return float(np.hypot(self.a_mm, self.b_mm))

    @property
    def pixels_per_slope(self) -> float:
        """Radius in the image over the tangent of the angle to the axis at the camera."""
        rim_radius = self.a_mm * np.sqrt((self.b_mm + self.rim_mm) ** 2 / self.b_mm**2 - 1)
        return self.circle.radius * float((self.b_mm + self.rim_mm + self.c_mm) / rim_radius)

    def _directions(self, x: Floats, y: Floats) -> Floats:
        x, y = x / self.pixels_per_slope, y / self.pixels_per_slope
        slope2 = x**2 + y**2
        # the ray F + t (x, y, 1) meets the upper sheet at
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.c_mm + self.b_mm * np.sqrt(1 + slope2)) / (1 - slope2 * (self.b_mm / self.a_mm) ** 2)
            Q = np.stack([t * x, t * y, t - 2 * self.c_mm], -1)  # as seen from F'
            return np.asarray(Q / np.linalg.norm(Q, axis=-1, keepdims=True))

    def _radius(self, elevation_rad: Floats) -> Floats:
        sin, cos = np.sin(elevation_rad), np.cos(elevation_rad)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = self.a_mm**2 / (self.b_mm - self.c_mm * sin)  # |QF| - |QF'| = 2b
            radius = self.pixels_per_slope * t * cos / (2 * self.c_mm + t * sin)
        return np.where(t > 0, radius, np.nan)


@dataclass(frozen=True)
class ParabolicMirror(MirrorCamera, CentralCamera):
    """An orthographic camera that looks up into a parabolic mirror (Nayar, 1997; named in Berenguer's thesis, 3.2).

    The mirror is z = (x^2 + y^2) / 2h - h / 2 with its focus, the viewpoint, at the origin: it has the radius h where it
    shows the horizon. All rays to the camera are parallel to the axis, and the image is a stereographic one. Lengths
    are in millimetres, and only their ratio matters. `crop` is that of `HyperbolicMirror`, here 1.0 by default.
    """

    crop: float = 1.0
    h_mm: float = 20.0  # the mirror's radius at the height of its focus
    rim_mm: float = 30.0  # from the mirror's apex up to its rim

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.h_mm, self.rim_mm) <= 0:
            raise ConfigError(
                f"a mirror with h={self.h_mm}, rim={self.rim_mm} mm has no parabola; give lengths above 0"
            )

    @property
    def horizon_px(self) -> float:
        """Radius of the horizon in the image."""
        return self.circle.radius * float(np.sqrt(self.h_mm / (2 * self.rim_mm)))

    def _directions(self, x: Floats, y: Floats) -> Floats:
        x, y = x / self.horizon_px, y / self.horizon_px
        r2 = x**2 + y**2
        return np.stack([2 * x, 2 * y, r2 - 1], -1) / (r2 + 1)[..., None]

    def _radius(self, elevation_rad: Floats) -> Floats:
        return np.asarray(self.horizon_px * np.tan(np.pi / 4 + np.asarray(elevation_rad) / 2))


THESIS_HALF = HyperbolicMirror(crop=0.5)
"""The thesis's virtual mirror as its own images show it: the central half, from straight down to +17.5 degrees."""

THESIS_WHOLE = HyperbolicMirror(crop=1.0)
"""The thesis's virtual mirror in full, up to +49.7 degrees."""

EIZOH_WIDE_70 = HyperbolicMirror(size=960, crop=1.0, a_mm=23.5, b_mm=80.8, rim_mm=64.15, margin_px=160)
"""Eizoh Wide 70 with a camera of 1280 x 960 pixels, the mirror filling the height.

Its data sheet fits no hyperbola with one viewpoint. Kept are the diameter of 70 mm, the 165 mm from camera to mirror
and the +60 degrees at the rim; given up are the printed height (35 mm; 64 here) and the lower end at -60 degrees (here
the image reaches straight down, where a real one shows the camera).
"""
