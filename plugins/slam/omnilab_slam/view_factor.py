"""A view seen from a robot, as a factor between two poses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats


def view_factor(robot: int, view: int, angles_rad: Floats, noise: Any) -> Any:
    """What was observed, bearing and relative orientation (2,), as GTSAM's factor between two of its poses.

    Both angles in one: their errors are correlated, and GTSAM's own bearing factor knows one of them.
    """
    import gtsam

    bearing, orientation = angles_rad.tolist()

    def error(_: Any, values: Any, derivatives: Any) -> npt.NDArray[np.float64]:
        a, b = values.atPose2(robot), values.atPose2(view)
        angles, by_robot, by_view = own_angles(a.x(), a.y(), a.theta(), b.x(), b.y(), b.theta())
        if derivatives is not None:
            derivatives[0], derivatives[1] = by_robot, by_view
        off = (angles[0] - bearing, angles[1] - orientation)
        return np.array([math.remainder(one, 2 * math.pi) for one in off])

    return gtsam.CustomFactor(noise, [robot, view], error)


def own_angles(
    x: float, y: float, heading: float, view_x: float, view_y: float, view_heading: float
) -> tuple[tuple[float, float], Floats, Floats]:
    """Bearing and relative orientation, and their derivatives (2, 3) by both poses as GTSAM moves them: in their own frames."""
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = view_x - x, view_y - y
    ahead, left = c * dx + s * dy, c * dy - s * dx
    squared = max(ahead * ahead + left * left, 1e-12)
    p, q = -left / squared, ahead / squared
    between = view_heading - heading
    c, s = math.cos(between), math.sin(between)
    by_robot = np.array([[-p, -q, -1.0], [0, 0, -1]])
    by_view = np.array([[p * c + q * s, q * c - p * s, 0], [0, 0, 1.0]])
    return (math.atan2(left, ahead), between), by_robot, by_view
