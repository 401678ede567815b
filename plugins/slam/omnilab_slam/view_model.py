"""Observation model of a view: its two angles, their Jacobians, gating, and which observations can be used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints, check_settings, setting
from omnilab.errors import DataError

SLACK = 1e-9  # of the largest eigenvalue: rounding may make one that is zero as negative as that


@dataclass
class Gate:
    """Gating of observations, settings that view filters share."""

    gate_probability: float = setting(0.999, above=0, at_most=1)  # of sound observations to be believed; 1: all are
    nearest_m: float = setting(0.2, above=0)  # views are observed from no nearer: those that seem to be are left out

    def __post_init__(self) -> None:
        check_settings(self, "view_filter.")

    @property
    def gate(self) -> float:
        """The squared Mahalanobis distance up to which two angles are believed: the quantile of chi2, two dof."""
        return float("inf") if self.gate_probability == 1 else float(-2 * np.log1p(-self.gate_probability))


class PredictedAngles(NamedTuple):
    """The predicted observations of K views, with their Jacobians."""

    angles_rad: Floats  # (K, 2) bearing and relative orientation, not wrapped
    J_robot: Floats  # (K, 2, 3) their Jacobians by the robot's pose
    J_view: Floats  # (K, 2, 3) and by each view's own
    distance_m: Floats  # (K,)

    def at(self, which: Ints) -> PredictedAngles:
        """The same of some of the views."""
        return PredictedAngles(*(each[which] for each in self))


def predict_angles(robot: Floats, views: Floats, nearest_m: float = 1e-6) -> PredictedAngles:
    """Bearings and relative orientations of views (K, 3) from a robot (3,), in the world's frame (Gil et al., 2012, eq. 12).

    Or from a robot (K, 3) for each. Nearer than `nearest_m` Jacobians are those of a view at that distance.
    """
    dx, dy = (views[:, :2] - robot[..., :2]).T
    squared = np.maximum(dx * dx + dy * dy, nearest_m**2)  # where it stands on a view, which is then left out
    J_view, J_robot = np.zeros((2, len(views), 2, 3))
    J_view[:, 0, 0], J_view[:, 0, 1], J_view[:, 1, 2] = -dy / squared, dx / squared, 1
    J_robot[:, 0, :2], J_robot[:, :, 2] = -J_view[:, 0, :2], -1
    angles = np.column_stack([np.arctan2(dy, dx), views[:, 2]]) - robot[..., 2, None]
    return PredictedAngles(angles, J_robot, J_view, np.sqrt(squared))


def usable(
    views: Ints, predicted: PredictedAngles, angles_rad: Floats, covariances: Floats, nearest_m: float, step: int
) -> tuple[Bools, list[str]]:
    """Which observations (K,) can be used: of views that are far enough, and sound; and warnings of those that are not sound."""
    finite, positive = np.isfinite(angles_rad).all(axis=1), is_covariance(covariances)
    wrong = {
        "angles that are no numbers": ~finite,
        "a covariance that is not positive definite": ~positive,
    }
    warnings = [
        f"step {step}: view {view} has {what}; it is left out" for what, which in wrong.items() for view in views[which]
    ]
    return finite & positive & (predicted.distance_m >= nearest_m), warnings


def is_covariance(matrices: Floats) -> Bools:
    """Which matrices (..., d, d) are finite and have no negative eigenvalue, (...,)."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    values = np.linalg.eigvalsh(np.where(finite[..., None, None], matrices, 0))
    return np.asarray(finite & (values[..., 0] >= -SLACK * np.abs(values[..., -1])))


def check_pose(what: str, pose: Floats, covariance: Floats) -> None:
    """DataError for a pose (3,) that is none, or a covariance (3, 3) of it: of the robot at the start, or of a view."""
    if not (np.isfinite(pose).all() and is_covariance(covariance)):
        raise DataError(
            f"{what} at {pose} with covariance {np.asarray(covariance).tolist()} is nowhere;"
            " give finite numbers and a positive definite matrix"
        )


def check_motion(motion: Floats, covariance: Floats, step: int) -> list[str]:
    """Warnings of a motion (3,) with its covariance (3, 3) that cannot be used; none if it can."""
    if not np.isfinite(motion).all():
        return [f"step {step}: the motion is no number; the robot is taken to stand still"]
    if not is_covariance(covariance):
        return [f"step {step}: the motion's covariance is not positive definite; the robot is taken to stand still"]
    return []


def mahalanobis(v: Floats, S: Floats) -> Floats:
    """Squared Mahalanobis distances (K,) of innovations (K, 2) by covariances (K, 2, 2); infinite where that is none."""
    determinant = S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] * S[:, 1, 0]
    squared = S[:, 1, 1] * v[:, 0] ** 2 - 2 * S[:, 0, 1] * v[:, 0] * v[:, 1] + S[:, 0, 0] * v[:, 1] ** 2
    positive = (determinant > 0) & (S[:, 0, 0] > 0)
    return np.asarray(np.divide(squared, determinant, out=np.full(len(v), np.inf), where=positive))


def planar_rotation(angle_rad: float) -> Floats:
    """The matrix (3, 3) that rotates x and y and leaves a heading."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
