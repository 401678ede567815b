"""View-based SLAM by particles that look before they move (FastSLAM 2.0; Montemerlo et al., 2003)."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Floats
from omnilab_slam.fast_slam import FastSlam
from omnilab_slam.particles import ParticleMap
from omnilab_slam.view_model import check_pose


@dataclass
class FastSlam2(FastSlam):
    """FastSLAM 2.0 on maps of views (Montemerlo et al., 2003): poses are drawn from what odometry and observations say together.

    Fewer particles are wasted where observations are more precise than odometry. The proposal of a particle is the Gaussian
    of an extended Kalman filter of its pose, over the observations of the step one by one (3.1 to 3.3 there).
    """

    def begin(self, pose: Floats, covariance: Floats) -> ParticleMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return ParticleMap(self, self.particles, self.seed, True, pose, covariance)
