"""Odometry from global appearance, with a robust fit of the direction of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, setting
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.odometries.appearance import Appearance

ROUNDS = 20
LEAST_MOVED = 1e-4  # radians: the least scale of the loss


@dataclass
class AppearanceFit(Appearance):
    """`appearance` with another direction: displacements go like the sine of the azimuth from the direction of motion.

    The sine is fitted by iteratively reweighted least squares under Cauchy's loss, whose scale is the median residual:
    near and wrong matches count little, and how far a match moved counts, not its sense alone. The mean of all
    displacements is an error of the rotation, which is known to a sample of the Radon transform: it is fitted, too, and
    subtracted.
    """

    detector: Detector = Detector.sift  # or surf, less precise
    direction_sigma_deg: float = setting(8.0, at_least=1e-6, at_most=1e6)  # of a direction of motion

    def _direction(self, azimuth_rad: Floats, moved_rad: Floats) -> tuple[float, float | None, float]:
        """The direction of motion in the new frame, no window, and the error of the rotation."""
        sine = np.column_stack([np.sin(azimuth_rad), -np.cos(azimuth_rad), np.ones_like(azimuth_rad)])
        common = float(
            np.angle(np.exp(1j * moved_rad).sum())
        )  # half a turn in corridors, which are alike in both directions
        moved_rad = wrap_angle(moved_rad - common)
        weight = np.ones(len(moved_rad))  # d = A sin(azimuth - beta) + offset
        for _ in range(ROUNDS):
            x = np.linalg.lstsq(sine * weight[:, None], moved_rad * weight, rcond=None)[0]
            off = np.abs(moved_rad - sine @ x)
            width = max(float(np.median(off)), LEAST_MOVED)
            weight = 1 / np.sqrt(1 + (off / width) ** 2)
        return float(np.arctan2(x[1], x[0])), None, common + float(x[2])
