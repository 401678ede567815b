"""When an image becomes a view: by its similarity to those there are, or by what it is expected to tell."""

from __future__ import annotations

from enum import Enum

import numpy as np

from omnilab.api import Floats


class Initialisation(Enum):
    """The rule by which images become views."""

    similarity = "similarity"  # as printed: R to all candidates is below a threshold (Gil et al., 2012, 2.3)
    information = "information"  # its expected information about the poses ahead is above one


def expected_gain(offsets_m: Floats, covariances: Floats, drift: Floats, sigma_rad: float, ahead_m: float) -> float:
    """What a view taken here is expected to tell about a pose so far ahead, beyond odometry and the views, in nats.

    The mutual information of Gaussians (Davison, 2005): half the logarithm of the ratio of the determinants of the pose's
    information with the new view and without it. Known are the views' positions from the robot (K, 2) in its own frame, the
    covariances (K, 2, 2) of the bearings and relative orientations observed now, that of odometry (3, 3) over `ahead_m`, and
    the standard deviation of both angles of a view seen from there; which way the robot goes is not known.
    """
    known = np.linalg.inv(drift)
    for (x, y), covariance in zip(offsets_m, covariances, strict=True):
        squared = max(x * x + y * y, 1e-12)
        J = np.array([[y / squared, -x / squared, -1], [0, 0, -1]])  # of both angles, by the robot's pose (eq. 12)
        known = known + J.T @ np.linalg.solve(covariance, J)
    new = np.diag([0.5 / ahead_m**2, 0.5 / ahead_m**2, 2.0]) / sigma_rad**2  # the mean over all directions ahead
    return float((np.linalg.slogdet(known + new)[1] - np.linalg.slogdet(known)[1]) / 2)
