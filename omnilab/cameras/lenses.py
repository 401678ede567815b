"""Central cameras around one optical axis: those that calibration tools describe, and those of lenses.

The literature's frame is (right, down, forward) in the picture, forward along the optical axis. `looks` says how it lies
in the camera frame of `omnilab.api`:

* ``down`` (a mirror above its camera, or a lens that looks down): right, down, forward are +x, -y, -z.
* ``up`` (a mirror below its camera, or a lens that looks up): +x, -y, +z.
* ``ahead`` (a lens that looks along +x): -y, -z, +x.

A camera that itself looks up, into a mirror or at the sky, takes pictures with azimuth running clockwise: flip them left
to right, and with `flipped` the camera that was calibrated on them.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from omnilab.api import Circle, Floats
from omnilab.cameras.base import CentralCamera, polar_pixels
from omnilab.cameras.distortion import distorted, radial, turning_radius, undistorted
from omnilab.cameras.plausibility import SHORTEST_PX, check_frame, check_numbers, check_positive
from omnilab.errors import ConfigError

AXES = {  # columns: right, down and forward in the camera frame
    "down": np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]], float),
    "up": np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1]], float),
    "ahead": np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float),
}


@dataclass(frozen=True, kw_only=True)
class AxialCamera(CentralCamera):
    """A camera around an optical axis. Directions outside the frame have no pixel."""

    width: int
    height: int
    cx: float  # where the axis meets the image, in pixels
    cy: float
    looks: str = "down"  # "down", "up" or "ahead"
    rim_px: float | None = None  # radius of the circle that shows the world; None: as far as frame and model reach
    inner_px: float = 0.0  # inside this radius the camera sees itself

    def __post_init__(self) -> None:
        check_frame(self.width, self.height)
        check_numbers(self)
        if self.looks not in AXES:
            raise ConfigError(f"looks={self.looks!r} is not known; a camera looks {', '.join(map(repr, AXES))}")
        if not (0 <= self.cx < self.width and 0 <= self.cy < self.height):
            raise ConfigError(
                f"the axis at ({self.cx:g}, {self.cy:g}) lies outside the {self.width} x {self.height} image;"
                " give cx and cy in pixels"
            )
        if not 0 <= self.inner_px < self.circle.radius:
            raise ConfigError(
                f"a ring from {self.inner_px:g} to {self.circle.radius:g} pixels shows nothing; give 0 <= inner_px < rim_px"
            )

    @property
    def circle(self) -> Circle:
        corner = np.hypot(*np.maximum([self.cx, self.cy], np.array([self.width, self.height]) - 1 - [self.cx, self.cy]))
        radius = min(corner + 1 if self.rim_px is None else self.rim_px, self._reach_px)
        return Circle(self.cx, self.cy, float(radius), self.inner_px)

    @property
    def elevations_rad(self) -> tuple[float, float]:
        """Of the largest circle that the frame shows whole."""
        azimuth = np.linspace(0, 2 * np.pi, 360, endpoint=False)
        ring = np.arcsin(self.directions(polar_pixels(self.circle, azimuth, np.full(360, self._whole_px)))[:, 2])
        lowest, highest = float(np.fmin.reduce(ring)), float(np.fmax.reduce(ring))  # NaN where nothing is seen
        return {"down": (-np.pi / 2, lowest), "up": (highest, np.pi / 2), "ahead": (lowest, highest)}[self.looks]

    @property
    def _whole_px(self) -> float:
        """Radius of the largest circle around the axis that the frame shows whole."""
        edges = (self.cx, self.cy, self.width - 1 - self.cx, self.height - 1 - self.cy)
        return min(self.circle.radius, min(edges) + 0.5) - 1e-6

    def directions(self, pixels: Floats) -> Floats:
        offset = np.asarray(pixels, float) - [self.cx, self.cy]
        beyond = np.hypot(offset[..., 0], offset[..., 1]) > self.circle.radius + 1e-9
        return np.where(beyond[..., None], np.nan, self._rays(offset) @ AXES[self.looks].T)

    def pixels(self, directions: Floats) -> Floats:
        d = np.asarray(directions, float)
        offset = self._offsets(d / np.linalg.norm(d, axis=-1, keepdims=True) @ AXES[self.looks])
        uv = offset + np.array([self.cx, self.cy])
        with np.errstate(invalid="ignore"):
            inside = np.hypot(offset[..., 0], offset[..., 1]) <= self.circle.radius + 1e-9
            inside &= ((uv >= -0.5 - 1e-9) & (uv <= np.array([self.width, self.height]) - 0.5 + 1e-9)).all(-1)
        return np.where(inside[..., None], uv, np.nan)

    def image_points(self, rays: Floats) -> Floats:
        """Points (..., 2) of the image plane, within the frame or beyond, of rays (..., 3) right, down and forward.

        The rays are of any length; NaN where the model has no point.
        """
        unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return np.asarray(self._offsets(unit) + np.array([self.cx, self.cy]))

    def rays(self, image_points: Floats) -> Floats:
        """The inverse: unit rays (..., 3), right, down and forward."""
        return self._rays(np.asarray(image_points, float) - [self.cx, self.cy])

    def flipped(self) -> Self:
        """The camera of the same pictures flipped left to right."""
        return replace(self, cx=self.width - 1 - self.cx)

    @property
    def _reach_px(self) -> float:
        """The radius up to which the model maps directions to pixels one to one."""
        return np.inf

    @abstractmethod
    def _rays(self, offset: Floats) -> Floats:
        """Unit directions (right, down, forward) at pixels as seen from the axis."""

    @abstractmethod
    def _offsets(self, rays: Floats) -> Floats:
        """The inverse of `_rays`; NaN where there is none."""


@dataclass(frozen=True, kw_only=True)
class UnifiedCamera(AxialCamera):
    """The unified model of central catadioptric cameras (Geyer & Daniilidis, 2000; Barreto & Araujo, 2001).

    Axes, K and the lens distortion are those of Mei & Rives (2007). A unit direction (X, Y, Z) = (right, down, forward) appears at
    K D(X / (Z + xi), Y / (Z + xi), 1), where D distorts by k1, k2 along the radius and by p1, p2 aside. xi is 0 for a pinhole, 1 for a
    parabolic mirror and 2 c b / (b^2 + c^2) for the hyperbolic mirror of `omnilab.cameras`.
    """

    fx: float
    fy: float
    xi: float
    skew: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    def __post_init__(self) -> None:
        if not (min(self.fx, self.fy) >= SHORTEST_PX and self.xi >= 0):
            raise ConfigError(
                f"fx={self.fx:g}, fy={self.fy:g}, xi={self.xi:g} is no camera; give fx, fy of {SHORTEST_PX} or more and xi of 0 or more"
            )
        if not np.isfinite(self._distortion).all():
            raise ConfigError(f"a distortion by k1, k2, p1, p2 = {self._distortion} is none; give finite numbers")
        super().__post_init__()

    @property
    def _reach_px(self) -> float:
        radius = self._reach
        if radius == np.inf:
            return np.inf
        return min(self.fx, self.fy) * radius * float(radial(np.array(radius**2), self._distortion))

    @property
    def _reach(self) -> float:
        """The radius before distortion where lines of sight graze the sphere (xi above 1), or distortion stops growing."""
        grazing = 1 / np.sqrt(self.xi**2 - 1) if self.xi > 1 else np.inf
        return float(min(grazing, turning_radius(self._distortion)))

    @property
    def _distortion(self) -> tuple[float, float, float, float]:
        return self.k1, self.k2, self.p1, self.p2

    def _rays(self, offset: Floats) -> Floats:
        y = offset[..., 1] / self.fy
        x = (offset[..., 0] - self.skew * y) / self.fx
        if any(self._distortion):
            x, y = np.moveaxis(undistorted(np.stack([x, y], -1), self._distortion), -1, 0)
        r2 = x**2 + y**2
        with np.errstate(invalid="ignore"):
            scale = (self.xi + np.sqrt(1 + (1 - self.xi**2) * r2)) / (1 + r2)
        return np.stack([scale * x, scale * y, scale - self.xi], -1)

    def _offsets(self, rays: Floats) -> Floats:
        X, Y, Z = np.moveaxis(rays, -1, 0)
        grazing = -min(self.xi, 1 / max(self.xi, 1e-12))
        depth = np.where(grazing < Z, Z + self.xi, np.nan)
        if any(self._distortion):
            plane = np.stack([X, Y], -1) / depth[..., None]
            plane[np.hypot(plane[..., 0], plane[..., 1]) > self._reach] = np.nan
            X, Y = np.moveaxis(distorted(plane, self._distortion), -1, 0)
            depth = np.ones_like(X)
        return np.stack([(self.fx * X + self.skew * Y) / depth, self.fy * Y / depth], -1)

    def flipped(self) -> Self:
        return replace(super().flipped(), skew=-self.skew, p2=-self.p2)


@dataclass(frozen=True, kw_only=True)
class PinholeCamera(AxialCamera):
    """A conventional camera: a direction appears at (focal X / Z, focal Y / Z) from the axis; it looks ahead by default."""

    looks: str = "ahead"
    focal_px: float

    def __post_init__(self) -> None:
        check_positive(self, "focal_px")
        super().__post_init__()

    def _rays(self, offset: Floats) -> Floats:
        through = np.concatenate([offset, np.full((*offset.shape[:-1], 1), self.focal_px)], -1)
        return np.asarray(through / np.linalg.norm(through, axis=-1, keepdims=True))

    def _offsets(self, rays: Floats) -> Floats:
        depth = np.where(rays[..., 2:] > 1e-12, rays[..., 2:], np.nan)
        return np.asarray(self.focal_px * rays[..., :2] / depth)


@dataclass(frozen=True, kw_only=True)
class FisheyeCamera(AxialCamera):
    """An equidistant fisheye: the distance from the axis in the image is focal times the angle to the axis, in radians."""

    focal_px: float

    def __post_init__(self) -> None:
        check_positive(self, "focal_px")
        super().__post_init__()

    @property
    def _reach_px(self) -> float:
        return self.focal_px * np.pi

    def _rays(self, offset: Floats) -> Floats:
        radius = np.hypot(offset[..., 0], offset[..., 1])
        return around_axis(offset, radius, radius / self.focal_px)

    def _offsets(self, rays: Floats) -> Floats:
        aside, angle = off_axis(rays)
        return aside * (self.focal_px * angle)[..., None]


def around_axis(offset: Floats, radius: Floats, angle_rad: Floats) -> Floats:
    """Unit directions (right, down, forward) at angles to the axis, on the side of `offset`, which is `radius` long."""
    aside = offset / np.where(radius > 0, radius, 1)[..., None]
    return np.concatenate([aside * np.sin(angle_rad)[..., None], np.cos(angle_rad)[..., None]], -1)


def off_axis(rays: Floats) -> tuple[Floats, Floats]:
    """The sides (..., 2), of unit length, to which directions lie from the axis, and their angles to it."""
    distance = np.hypot(rays[..., 0], rays[..., 1])
    aside = rays[..., :2] / np.where(distance > 0, distance, 1)[..., None]
    aside[distance == 0] = [1, 0]  # straight ahead any side does; straight back lies on a circle, not in its centre
    return aside, np.arctan2(distance, rays[..., 2])
