"""View-based SLAM by an extended Kalman filter (Gil et al., 2012, eq. 1 to 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam.view_model import (
    Gate,
    PredictedAngles,
    check_motion,
    check_pose,
    mahalanobis,
    planar_rotation,
    predict_angles,
    usable,
)

ROOM = 16  # views that there is room for at first; doubled when it is full


@dataclass
class ViewEkf(Gate):
    """Extended Kalman filter over the robot's pose and those of all views (Gil et al., 2012, eq. 1 to 12).

    The time of a step grows with the square of the number of views. What was linearised is never revised: where it is
    unsure of headings, the estimate becomes overconfident. The trajectory of `finish` is the online estimate, step by step.
    """

    def begin(self, pose: Floats, covariance: Floats) -> EkfMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return EkfMap(self, pose, covariance)


class EkfMap:
    """State and covariance of the robot and the views, the robot first, in arrays with room to grow."""

    def __init__(self, settings: Gate, pose: Floats, covariance: Floats) -> None:
        self._settings, self._size = settings, 3
        self._state, self._cov = np.zeros(3 + 3 * ROOM), np.zeros((3 + 3 * ROOM, 3 + 3 * ROOM))
        self._state[:3], self._cov[:3, :3] = pose, covariance
        self._trajectory = [self._state[:3].copy()]

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`; eq. 4 and 6."""
        warnings = check_motion(motion, covariance, len(self._trajectory))
        if not warnings:
            n, P, before = self._size, self._cov, self._state[:3].copy()
            self._state[:3] = moved(before, motion)
            dx, dy = self._state[:2] - before[:2]
            F, G = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1.0]]), planar_rotation(before[2])
            P[:3, 3:n] = F @ P[:3, 3:n]
            P[3:n, :3] = P[:3, 3:n].T
            robot = F @ P[:3, :3] @ F.T + G @ covariance @ G.T
            P[:3, :3] = (robot + robot.T) / 2
        self._trajectory.append(self._state[:3].copy())
        return warnings

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`; eq. 7 to 12, of all views at once. Each is gated by itself."""
        step, rows = len(self._trajectory) - 1, 3 + 3 * views[:, None] + np.arange(3)
        predicted = predict_angles(self._state[:3], self._state[rows])
        believed, warnings = usable(views, predicted, angles_rad, covariances, self._settings.nearest_m, step)
        if not believed.any():
            return believed, warnings
        fit = np.flatnonzero(believed)
        predicted = predicted.at(fit)
        v = wrap_angle(angles_rad[fit] - predicted.angles_rad)
        PHt, S = self._innovation_covariance(rows[fit], predicted, covariances[fit])
        inside = mahalanobis(v, diagonal_blocks(S)) <= self._settings.gate
        if inside.any() and not self._update(PHt, S, v, inside):
            warnings.append(
                f"step {step}: the covariance is not positive definite; the step's observations are left out"
            )
            inside[:] = False
        believed[fit] = inside
        self._trajectory[-1] = self._state[:3].copy()
        return believed, warnings

    def _innovation_covariance(self, rows: Ints, predicted: PredictedAngles, R: Floats) -> tuple[Floats, Floats]:
        """P H^T (n, 2K) and innovation covariance S = H P H^T + R (2K, 2K), from the few columns of H that are not zero."""
        count, used = len(rows), np.concatenate([np.arange(3), rows.ravel()])
        k = np.arange(count)
        H = np.zeros((count, 2, 3 + 3 * count))
        H[:, :, :3] = predicted.J_robot
        H[:, :, 3:].reshape(count, 2, count, 3)[k, :, k] = predicted.J_view
        flat = H.reshape(2 * count, -1)
        PHt = self._cov[: self._size, used] @ flat.T
        S = flat @ PHt[used]
        S.reshape(count, 2, count, 2)[k, :, k] += R
        return PHt, (S + S.T) / 2

    def _update(self, PHt: Floats, S: Floats, v: Floats, inside: Bools) -> bool:
        """Gain and update by the observations inside the gate; False, and nothing changed, where P is no covariance."""
        n, both = self._size, np.repeat(inside, 2)
        try:
            L = np.linalg.cholesky(S[both][:, both])
        except np.linalg.LinAlgError:
            return False
        solved = np.linalg.solve(L, np.column_stack([PHt[:, both].T, v[inside].ravel()]))
        W = solved[:, :-1]  # L^-1 H P: K S K^T is W^T W, symmetric to the last bit
        if (np.diagonal(self._cov)[:n] < (W * W).sum(axis=0)).any():
            return False
        self._state[:n] += W.T @ solved[:, -1]
        self._state[2] = wrap_angle(self._state[2])
        self._cov[:n, :n] -= W.T @ W
        return True

    def add_view(self) -> int:
        """See `omnilab.api.ViewMap`."""
        n, new = self._size, self._grow()
        P = self._cov
        self._state[new] = self._state[:3]
        P[new, :n], P[:n, new], P[new, new] = P[:3, :n], P[:n, :3], P[:3, :3]
        return n // 3 - 1

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """See `omnilab.api.ViewMap`."""
        check_pose("a view", pose, covariance)
        n, new = self._size, self._grow()
        self._state[new], self._cov[new, new] = pose, covariance
        return n // 3 - 1

    def _grow(self) -> slice:
        """Room for one more pose: its slice of the state; it is zero, and so are its covariances."""
        n = self._size
        if n == len(self._state):
            state, cov = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
            state[:n], cov[:n, :n] = self._state, self._cov
            self._state, self._cov = state, cov
        self._size += 3
        return slice(n, n + 3)

    def pose(self) -> tuple[Floats, Floats]:
        """See `omnilab.api.ViewMap`."""
        return self._state[:3].copy(), self._cov[:3, :3].copy()

    def views(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        poses = self._state[3 : self._size].reshape(-1, 3).copy()
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses

    def view_covariances(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        n = self._size
        k = np.arange(n // 3 - 1)
        return np.asarray(self._cov[3:n, 3:n].reshape(len(k), 3, len(k), 3)[k, :, k])

    def finish(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return np.array(self._trajectory)


def diagonal_blocks(S: Floats) -> Floats:
    """The covariances (K, 2, 2) of single observations within that of all (2K, 2K)."""
    k = np.arange(len(S) // 2)
    return np.asarray(S.reshape(len(k), 2, len(k), 2)[k, :, k])
