"""View-based SLAM by particles (FastSLAM; Montemerlo et al., 2002)."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Floats, setting
from omnilab_slam.particles import ParticleMap
from omnilab_slam.view_model import Gate, check_pose


@dataclass
class FastSlam(Gate):
    """FastSLAM on maps of views (Montemerlo et al., 2002): particles are trajectories of the robot, drawn by odometry.

    Given a trajectory, views are independent, each with a Kalman filter of its own (eq. 2 and 3 there); those that the robot
    took are even certain, being poses of that trajectory, so that the weights, the likelihoods of the observations, do all
    the work. `finish` is the mean trajectory of the particles that are left.
    """

    particles: int = setting(500, at_least=2, at_most=100_000)  # time and memory grow with them
    seed: int = setting(0, at_least=0)  # of what is drawn

    def begin(self, pose: Floats, covariance: Floats) -> ParticleMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return ParticleMap(self, self.particles, self.seed, False, pose, covariance)
