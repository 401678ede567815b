"""The fisheye camera of Kannala & Brandt (2006) with four coefficients: OpenCV's `fisheye`, Kalibr's `equidistant`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.distortion import smallest_positive_root, solve_growing
from omnilab.cameras.lenses import AxialCamera, around_axis, off_axis
from omnilab.cameras.plausibility import check_positive


@dataclass(frozen=True, kw_only=True)
class KannalaBrandtCamera(AxialCamera):
    """A fisheye lens whose radius in the image is an odd polynomial of the angle to the axis (Kannala & Brandt, 2006).

    A direction at the angle t to the axis, to the side (x, y) = (right, down) of unit length, appears at
    (fx r x + skew r y, fy r y) from the axis, r = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8). With all of k1 to k4 zero
    it is the equidistant `FisheyeCamera`. Beyond the angle where r stops growing (or 180 degrees) there are no rays.
    OpenCV's `fisheye` calls skew / fx `alpha`.
    """

    fx: float
    fy: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    skew: float = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "fx", "fy")
        super().__post_init__()

    @property
    def largest_angle_rad(self) -> float:
        """The angle to the axis up to which the lens maps angles to radii one to one."""
        slope = np.poly1d([9 * self.k4, 7 * self.k3, 5 * self.k2, 3 * self.k1, 1])  # of the square of the angle
        return min(float(np.sqrt(smallest_positive_root(slope))), np.pi)

    @property
    def _reach_px(self) -> float:
        radius, _ = self._radius(np.asarray(self.largest_angle_rad))
        return min(self.fx, self.fy) * float(radius)

    def _radius(self, angle_rad: Floats) -> tuple[Floats, Floats]:
        """r of angles, and its slope."""
        square = angle_rad**2
        powers = 1 + square * (self.k1 + square * (self.k2 + square * (self.k3 + square * self.k4)))
        slope = 1 + square * (3 * self.k1 + square * (5 * self.k2 + square * (7 * self.k3 + square * 9 * self.k4)))
        return angle_rad * powers, slope

    def _rays(self, offset: Floats) -> Floats:
        y = offset[..., 1] / self.fy
        plane = np.stack([(offset[..., 0] - self.skew * y) / self.fx, y], -1)
        radius = np.hypot(plane[..., 0], plane[..., 1])
        return around_axis(plane, radius, solve_growing(self._radius, radius, self.largest_angle_rad))

    def _offsets(self, rays: Floats) -> Floats:
        aside, angle = off_axis(rays)
        radius, _ = self._radius(np.where(angle <= self.largest_angle_rad, angle, np.nan))
        x, y = np.moveaxis(aside * radius[..., None], -1, 0)
        return np.stack([self.fx * x + self.skew * y, self.fy * y], -1)

    def flipped(self) -> Self:
        return replace(super().flipped(), skew=-self.skew)
