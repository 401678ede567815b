"""Simulated odometry: the true motion with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Frames, Motion, check_settings, setting
from omnilab.errors import DataError
from omnilab.posegraph.graph import inverse, vectors


@dataclass
class Simulated:
    """Simulated wheel odometry: the true motion in the plane, in metres, with normal noise from the run's seed.

    x and y are off by a share of the step, the heading by a constant and a share of the rotation, independently; the
    covariance is that of this noise. `scale` is a systematic error of all lengths, which the covariance leaves out.
    """

    translation_noise: float = setting(
        0.05, at_least=0, at_most=1000
    )  # standard deviation of x and of y, as a share of the step
    still_noise_m: float = setting(0.001, at_least=1e-12, at_most=1e6)  # and at least, of a step of no length
    heading_noise_deg: float = setting(0.5, at_least=1e-12, at_most=1e6)  # standard deviation of the heading, at least
    turn_noise: float = setting(0.02, at_least=0, at_most=1000)  # and as a share of the rotation
    scale: float = setting(1.0, at_least=1e-6, at_most=1e6)  # what all lengths are multiplied by

    def __post_init__(self) -> None:
        check_settings(self)

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
