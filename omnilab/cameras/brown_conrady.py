"""The conventional camera with lens distortion: OpenCV's pinhole model, Kalibr's `pinhole-radtan`, ROS's `plumb_bob`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.distortion import (
    Coefficients,
    distorted,
    radial,
    radial_slope,
    solve_growing,
    turning_radius,
    undistorted,
)
from omnilab.cameras.lenses import AxialCamera
from omnilab.cameras.plausibility import check_positive

FARTHEST = 1e6  # from the axis, in focal lengths
WIDEST = 1e3  # tangent of the angle to the axis, 89.94 degrees: nothing is sought beyond


@dataclass(frozen=True, kw_only=True)
class BrownConradyCamera(AxialCamera):
    """A pinhole with radial and tangential distortion (Conrady, 1919; Brown, 1966), as OpenCV and ROS write it.

    A direction (X, Y, Z) = (right, down, forward) appears at (fx x, fy y) from the axis, (x, y) = D(X / Z, Y / Z), where
    D moves points along the radius by k1 to k3, in the rational model over k4 to k6, and aside by p1, p2
    (`omnilab.cameras.distortion`). It looks ahead by default. Beyond the radius where D folds there are no rays.
    """

    looks: str = "ahead"
    fx: float
    fy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "fx", "fy")
        super().__post_init__()

    @property
    def _distortion(self) -> Coefficients:
        return self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6

    @property
    def _reach(self) -> float:
        """The radius before distortion, up to which it grows."""
        return turning_radius(self._distortion)

    @property
    def _reach_px(self) -> float:
        if self._reach == np.inf:
            return np.inf
        with np.errstate(divide="ignore"):  # the ratio may have a pole there
            radius = self._reach * float(radial(np.array(self._reach**2), self._distortion))
        return min(self.fx, self.fy) * radius if 0 < radius < FARTHEST else np.inf

    def _rays(self, offset: Floats) -> Floats:
        plane: Floats = offset / np.array([self.fx, self.fy])
        if any(self._distortion):
            plane = undistorted(plane, self._distortion, self._radially(plane))
        through = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], -1)
        return np.asarray(through / np.linalg.norm(through, axis=-1, keepdims=True))

    def _radially(self, plane: Floats) -> Floats:
        """Where points (..., 2) were before distortion along the radius alone, which is the most of it."""

        def moved(radius: Floats) -> tuple[Floats, Floats]:
            factor = radial(radius**2, self._distortion)
            return radius * factor, factor + 2 * radius**2 * radial_slope(radius**2, self._distortion)

        radius = np.hypot(plane[..., 0], plane[..., 1])
        before = solve_growing(moved, radius, min(self._reach, WIDEST))
        factor = np.where(np.isfinite(before), before, radius) / np.where(radius > 0, radius, 1)
        return np.asarray(plane * factor[..., None])

    def _offsets(self, rays: Floats) -> Floats:
        plane = rays[..., :2] / np.where(rays[..., 2:] > 1e-12, rays[..., 2:], np.nan)
        with np.errstate(invalid="ignore"):
            plane = np.where((np.hypot(plane[..., 0], plane[..., 1]) <= self._reach)[..., None], plane, np.nan)
        return np.asarray(distorted(plane, self._distortion) * [self.fx, self.fy])

    def flipped(self) -> Self:
        return replace(super().flipped(), p2=-self.p2)
