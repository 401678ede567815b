"""Simulated odometry: the true motion with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Frames, Motion
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.graph import inverse, vectors


@dataclass
class Simulated:
    """Simulated wheel odometry: the true motion in the plane, in metres, with normal noise from the run's seed.

    x and y are off by a share of the step, the heading by a constant and a share of the rotation, independently; the
    covariance is that of this noise. `scale` is a systematic error of all lengths, which the covariance leaves out.
    """

    translation_noise: float = 0.05  # standard deviation of x and of y, as a share of the step
    still_noise_m: float = 0.001  # and at least, of a step of no length
    heading_noise_deg: float = 0.5  # standard deviation of the heading, at least
    turn_noise: float = 0.02  # and as a share of the rotation
    scale: float = 1.0  # what all lengths are multiplied by

    def __post_init__(self) -> None:
        shares, least = (self.translation_noise, self.turn_noise), (self.still_noise_m, self.heading_noise_deg)
        if not (all(0 <= s < np.inf for s in shares) and all(0 < s < np.inf for s in least)):
            raise ConfigError(
                f"translation_noise={self.translation_noise:g}, turn_noise={self.turn_noise:g}, still_noise_m="
                f"{self.still_noise_m:g}, heading_noise_deg={self.heading_noise_deg:g} are no noise; give shares from 0 and"
                " the last two above 0"
            )
        if not 0 < self.scale < np.inf:
            raise ConfigError(f"scale={self.scale:g} is no factor of lengths; give a number above 0, such as 1")

    def extract(self, frames: Frames) -> Sequence[Floats]:
        """The pose (4, 4) of each image; DataError without poses."""
        if frames.T_world_camera is None:
            raise DataError(
                "odometry=simulated needs the poses that it spoils, and the images have none; give the recording poses, or"
                " choose another odometry"
            )
        return list(frames.T_world_camera)

    def estimate(self, before: Floats, now: Floats, rng: np.random.Generator) -> Motion:
        """The true motion with noise, in metres."""
        (truth,) = vectors((inverse(before) @ now)[None], planar=True)
        truth[:2] *= self.scale
        place = np.hypot(self.translation_noise * np.hypot(*truth[:2]), self.still_noise_m)
        heading = np.hypot(np.deg2rad(self.heading_noise_deg), self.turn_noise * truth[2])
        sigma = np.array([place, place, heading])
        return Motion(truth + sigma * rng.standard_normal(3), np.diag(sigma**2), "m")
