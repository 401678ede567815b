"""The observation of a view as a factor between two poses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats

FLOOR = 1e-12  # m², rad²: added to variances, so that a robot that stands still and knows it has an inverse covariance
SOFTNESS = 0.25  # of the least distance: standard deviation of a view that seems nearer


def view_factor(robot: int, view: int, angles_rad: Floats, covariance: Floats, nearest_m: float) -> Any:
    """GTSAM's factor of an observed bearing and relative orientation (2,) with covariance (2, 2), between two poses.

    Both angles in one: their errors are correlated, and GTSAM's own bearing factor has only one of them. A third row keeps
    the poses apart: close to a view the slightest move explains any bearing, which draws poses there, and where the
    Jacobian is that large the covariance means nothing.
    """
    import gtsam

    bearing, orientation = angles_rad.tolist()
    extended = np.diag([0, 0, (SOFTNESS * nearest_m) ** 2])
    extended[:2, :2] = covariance

    def error(_: Any, values: Any, jacobians: Any) -> npt.NDArray[np.float64]:
        a, b = values.atPose2(robot), values.atPose2(view)
        predicted, J_robot, J_view = angles_in_own_frames(a.x(), a.y(), a.theta(), b.x(), b.y(), b.theta(), nearest_m)
        if jacobians is not None:
            jacobians[0], jacobians[1] = J_robot, J_view
        off = (
            math.remainder(predicted[0] - bearing, 2 * math.pi),
            math.remainder(predicted[1] - orientation, 2 * math.pi),
        )
        return np.array([*off, predicted[2]])

    return gtsam.CustomFactor(noise_of_covariance(extended), [robot, view], error)


def angles_in_own_frames(
    x: float, y: float, heading: float, view_x: float, view_y: float, view_heading: float, nearest_m: float
) -> tuple[tuple[float, float, float], Floats, Floats]:
    """Bearing, relative orientation and the metres that a view is too near, and their Jacobians (3, 3) by both poses.

    The Jacobians are those of moves in each pose's own frame, as GTSAM's retraction makes them.
    """
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = view_x - x, view_y - y
    ahead, left = c * dx + s * dy, c * dy - s * dx
    squared = max(ahead * ahead + left * left, 1e-12)
    distance = math.sqrt(squared)
    short = max(0.0, nearest_m - distance)
    p, q = -left / squared, ahead / squared
    u, v = (ahead / distance, left / distance) if short else (0.0, 0.0)
    between = view_heading - heading
    c, s = math.cos(between), math.sin(between)
    J_robot = np.array([[-p, -q, -1.0], [0, 0, -1], [u, v, 0]])
    J_view = np.array([[p * c + q * s, q * c - p * s, 0], [0, 0, 1.0], [-u * c - v * s, u * s - v * c, 0]])
    return (math.atan2(left, ahead), between, short), J_robot, J_view


def noise_of_covariance(covariance: Floats) -> Any:
    """GTSAM's Gaussian noise model of a covariance (d, d)."""
    import gtsam

    return gtsam.noiseModel.Gaussian.Covariance(covariance + FLOOR * np.eye(len(covariance)))
