"""Extended Kalman filter over a robot's planar pose and whatever its map consists of."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam.view_model import Gate, check_motion, mahalanobis, planar_rotation

ROOM = 48  # variables of the map that there is room for at first; doubled when it is full


class PoseMapEkf:
    """State and covariance of the robot and its map, the robot first, in arrays with room to grow.

    Maps consist of elements of `width` variables each, observed by two angles each.
    """

    width: int

    def __init__(self, settings: Gate, pose: Floats, covariance: Floats) -> None:
        self._settings, self._size = settings, 3
        self._state, self._cov = np.zeros(3 + ROOM), np.zeros((3 + ROOM, 3 + ROOM))
        self._state[:3], self._cov[:3, :3] = pose, covariance
        self._trajectory = [self._state[:3].copy()]

    @property
    def variables(self) -> int:
        """How many variables are estimated."""
        return self._size

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`; Gil et al. (2012), eq. 4 and 6."""
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

    def rows(self, elements: Ints) -> Ints:
        """The rows (K, width) of elements (K,) of the map in the state."""
        return np.asarray(3 + self.width * elements[:, None] + np.arange(self.width))

    def update(self, rows: Ints, v: Floats, J_robot: Floats, J_own: Floats, R: Floats) -> tuple[Bools, list[str]]:
        """Update by K observations of two angles each, of elements at rows (K, width): which are believed, and warnings.

        Innovations v are (K, 2), their Jacobians by the robot's pose (K, 2, 3), and by the elements (K, 2, width), the
        noise R is (K, 2, 2). Each is gated by itself; all that are believed are taken at once (Gil et al., 2012, eq. 7 to 11).
        """
        PHt, S = self._innovation_covariance(rows, J_robot, J_own, R)
        inside = mahalanobis(v, diagonal_blocks(S)) <= self._settings.gate
        warnings = []
        if inside.any() and not self._correct(PHt, S, v, inside):
            step = len(self._trajectory) - 1
            warnings.append(
                f"step {step}: the covariance is not positive definite; the step's observations are left out"
            )
            inside[:] = False
        self._trajectory[-1] = self._state[:3].copy()
        return inside, warnings

    def _innovation_covariance(self, rows: Ints, J_robot: Floats, J_own: Floats, R: Floats) -> tuple[Floats, Floats]:
        """P H^T (n, 2K) and innovation covariance S = H P H^T + R (2K, 2K), from the few columns of H that are not zero."""
        count, width, used = len(rows), self.width, np.concatenate([np.arange(3), rows.ravel()])
        k = np.arange(count)
        H = np.zeros((count, 2, 3 + width * count))
        H[:, :, :3] = J_robot
        H[:, :, 3:].reshape(count, 2, count, width)[k, :, k] = J_own
        flat = H.reshape(2 * count, -1)
        PHt = self._cov[: self._size, used] @ flat.T
        S = flat @ PHt[used]
        S.reshape(count, 2, count, 2)[k, :, k] += R
        return PHt, (S + S.T) / 2

    def _correct(self, PHt: Floats, S: Floats, v: Floats, inside: Bools) -> bool:
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

    def grow(self) -> slice:
        """Room for one more element: its slice of the state; it is zero, and so are its covariances."""
        n = self._size
        if n + self.width > len(self._state):
            state, cov = np.zeros(2 * len(self._state)), np.zeros((2 * len(self._state), 2 * len(self._state)))
            state[:n], cov[:n, :n] = self._state[:n], self._cov[:n, :n]
            self._state, self._cov = state, cov
        self._size += self.width
        return slice(n, n + self.width)

    def pose(self) -> tuple[Floats, Floats]:
        """See `omnilab.api.ViewMap`."""
        return self._state[:3].copy(), self._cov[:3, :3].copy()

    def element_covariances(self) -> Floats:
        """The covariances (N, width, width) of the elements."""
        n = self._size
        k = np.arange((n - 3) // self.width)
        return np.asarray(self._cov[3:n, 3:n].reshape(len(k), self.width, len(k), self.width)[k, :, k])

    def finish(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return np.array(self._trajectory)


def diagonal_blocks(S: Floats) -> Floats:
    """The covariances (K, 2, 2) of single observations within that of all (2K, 2K)."""
    k = np.arange(len(S) // 2)
    return np.asarray(S.reshape(len(k), 2, len(k), 2)[k, :, k])
