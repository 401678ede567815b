"""Observation model of a landmark in inverse depth: its direction, and the Jacobians (Civera et al., 2008)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Floats

LEAST_INVERSE_M = 1e-3  # 1/m: a landmark that is farther, or beyond infinity, is placed at a kilometre


class PredictedDirections(NamedTuple):
    """The predicted directions of K landmarks, with their Jacobians."""

    angles_rad: Floats  # (K, 2) azimuth in the robot's frame, not wrapped, and elevation
    J_robot: Floats  # (K, 2, 3) their Jacobians by the robot's pose
    J_landmark: Floats  # (K, 2, 5) and by each landmark's own variables
    level: Floats  # (K,) the part of the vector to it that is level, times its inverse depth: near zero straight above


def predict_directions(robot: Floats, landmarks: Floats) -> PredictedDirections:
    """Directions of landmarks (K, 5) from a robot (3,), both in the world's frame.

    A landmark is x and y where it was first observed (m), the azimuth and elevation in which it was seen from there, and
    its inverse distance from there (1/m). The vector to it, times that, is rho (anchor - robot) + m (Civera et al., 2008,
    eq. 3 and 7); the camera stays at one height, which therefore cancels. Defined for points at infinity.
    """
    x, y, azimuth, elevation, rho = landmarks.T
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    ax, ay = x - robot[0], y - robot[1]
    h = np.stack([rho * ax + ce * ca, rho * ay + ce * sa, se], axis=1)
    zero, one = np.zeros_like(x), np.ones_like(x)
    J_h = np.stack([
        np.stack([rho, zero, -ce * sa, -se * ca, ax], axis=1),
        np.stack([zero, rho, ce * ca, -se * sa, ay], axis=1),
        np.stack([zero, zero, zero, ce, zero], axis=1),
    ], axis=1)  # fmt: skip
    level2 = np.maximum(h[:, 0] ** 2 + h[:, 1] ** 2, 1e-12)
    level, whole2 = np.sqrt(level2), level2 + h[:, 2] ** 2
    J_angles = np.stack([
        np.stack([-h[:, 1] / level2, h[:, 0] / level2, zero], axis=1),
        np.stack([-h[:, 2] * h[:, 0] / (level * whole2), -h[:, 2] * h[:, 1] / (level * whole2), level / whole2], axis=1),
    ], axis=1)  # fmt: skip
    J_robot = np.empty((len(x), 2, 3))
    J_robot[:, :, :2] = -rho[:, None, None] * J_angles[:, :, :2]
    J_robot[:, 0, 2], J_robot[:, 1, 2] = -one, zero
    angles = np.column_stack([np.arctan2(h[:, 1], h[:, 0]) - robot[2], np.arctan2(h[:, 2], level)])
    return PredictedDirections(angles, J_robot, J_angles @ J_h, level)


def positions(landmarks: Floats) -> tuple[Floats, Floats]:
    """Positions (K, 3) of landmarks (K, 5), z over the camera's height, and their Jacobians (K, 3, 5)."""
    x, y, azimuth, elevation, rho = landmarks.T
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    depth = 1 / np.maximum(rho, LEAST_INVERSE_M)
    m = np.stack([ce * ca, ce * sa, se], axis=1)
    J = np.zeros((len(x), 3, 5))
    J[:, 0, 0], J[:, 1, 1] = 1, 1
    J[:, :, 2] = depth[:, None] * np.stack([-ce * sa, ce * ca, np.zeros_like(x)], axis=1)
    J[:, :, 3] = depth[:, None] * np.stack([-se * ca, -se * sa, ce], axis=1)
    J[:, :, 4] = -(depth**2)[:, None] * m
    return np.column_stack([x, y, np.zeros_like(x)]) + depth[:, None] * m, J
