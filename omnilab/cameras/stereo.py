"""Two equal conventional cameras side by side, in one picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from omnilab.api import Circle, Floats
from omnilab.cameras.base import RayCamera
from omnilab.cameras.lenses import PinholeCamera
from omnilab.cameras.plausibility import check_frame, check_numbers
from omnilab.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class StereoCamera(RayCamera):
    """Two pinholes that look ahead along +x, in one picture: its left half starts at +y baseline / 2, its right at -y.

    `circle`, `elevations_rad` and `unwrap` are those of the left half; the axes meet the halves in their middle.
    """

    width: int  # of both halves together
    height: int
    focal_px: float
    baseline_m: float

    def __post_init__(self) -> None:
        check_frame(self.width, self.height)
        check_numbers(self)
        if self.width % 2:
            raise ConfigError(f"width={self.width} has no two halves; give an even number of pixels")
        if not 0 < self.baseline_m < np.inf:
            raise ConfigError(f"baseline_m={self.baseline_m:g} is no distance between cameras; give metres above 0")
        _ = self.left  # checks the rest

    @property
    def left(self) -> PinholeCamera:
        """The camera of the left half, and of the right: they differ in where they stand."""
        half = self.width // 2
        return PinholeCamera(
            width=half, height=self.height, cx=(half - 1) / 2, cy=(self.height - 1) / 2, focal_px=self.focal_px
        )

    right = left

    @property
    def circle(self) -> Circle:
        return self.left.circle

    @property
    def looks(self) -> str:
        """Where the axes lie: that of `AxialCamera`."""
        return self.left.looks

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return self.left.elevations_rad

    def directions(self, pixels: Floats) -> Floats:
        return self.left.directions(pixels - self._shift * self._in_right(pixels)[..., None])

    def origins(self, pixels: Floats) -> Floats:
        return np.where(self._in_right(pixels)[..., None], -self._aside, self._aside)

    def pixels(self, directions: Floats) -> Floats:
        """Pixels (..., 2) of the left half that show directions (..., 3)."""
        return self.left.pixels(directions)

    def project(self, points_m: Floats) -> Floats:
        """Pixels (..., 2) of the left half that show points (..., 3) in the camera frame."""
        return self.left.pixels(points_m - self._aside)

    def project_right(self, points_m: Floats) -> Floats:
        """Pixels (..., 2) of the right half that show points (..., 3) in the camera frame."""
        return self.right.pixels(points_m + self._aside) + self._shift

    @property
    def _aside(self) -> Floats:
        """From the frame's origin to the left camera, in metres."""
        return np.array([0, self.baseline_m / 2, 0])

    @property
    def _shift(self) -> Floats:
        """From a pixel of the left half to its like in the right one."""
        return np.array([self.width / 2, 0])

    def _in_right(self, pixels: Floats) -> npt.NDArray[np.bool_]:
        return np.asarray(np.asarray(pixels)[..., 0] >= self.width / 2 - 0.5)
