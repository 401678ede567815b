"""Extended Kalman filter over a robot's planar pose and whatever its map consists of.

In large maps, what an update does to elements that are not observed is postponed (compressed EKF; Guivant and Nebot, 2001).
"""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam.view_model import Gate, check_motion, mahalanobis, planar_rotation

ROOM = 48  # variables of the map that there is room for at first; doubled when it is full

DENSE = 360  # variables up to which every update is carried out at once
MOST_ACTIVE = 90  # variables of which updates are kept apart; those observed at once may be more
BLOCK = 128  # rows of the covariance that are changed at a time: they fit into a cache


class Active:
    """The part A of a map that is being observed, and what that does to its rest B, not carried out yet.

    With G = P_AB, b and P_BB from when the rest was last carried out, at present P_AB is `phi` G, the rest's covariance is
    P_BB - G^T `theta` G and its state is b + G^T `shift`. All this is exact, and takes time by the size of A alone.
    """

    def __init__(self, state: Floats, cov: Floats) -> None:
        self.rows: Ints = np.arange(3)
        self.state, self.cov = state[:3].copy(), cov[:3, :3].copy()
        self.phi, self.theta, self.shift = np.eye(3), np.zeros((3, 3)), np.zeros(3)

    def places(self, rows: Ints) -> Ints:
        """Where rows of the whole state are in this part's; -1: not in it."""
        order = np.argsort(self.rows)
        at = order[np.minimum(np.searchsorted(self.rows, rows, sorter=order), len(order) - 1)]
        return np.where(self.rows[at] == rows, at, -1)

    def join(self, rows: Ints, state: Floats, cov: Floats) -> None:
        """Rows (m,) of the rest, whose state and covariance are given, become part of this one."""
        G = cov[np.ix_(self.rows, rows)]
        own = cov[np.ix_(rows, rows)] - G.T @ self.theta @ G
        self._extend(rows, state[rows] + G.T @ self.shift, self.phi @ G, (own + own.T) / 2, -G.T @ self.theta)
        self.phi[-len(rows) :, -len(rows) :] = np.eye(len(rows))

    def take(self, rows: Ints) -> None:
        """New rows (3,) become part of this one: a copy of the robot's pose."""
        self._extend(rows, self.state[:3], self.cov[:, :3], self.cov[:3, :3], self.phi[:3])

    def _extend(self, rows: Ints, state: Floats, cross: Floats, own: Floats, phi: Floats) -> None:
        m = len(rows)
        self.rows, self.state = np.concatenate([self.rows, rows]), np.concatenate([self.state, state])
        self.cov = np.block([[self.cov, cross], [cross.T, own]])
        self.phi = np.block([[self.phi, np.zeros((len(self.phi), m))], [phi, np.zeros((m, m))]])
        self.theta, self.shift = np.pad(self.theta, (0, m)), np.pad(self.shift, (0, m))

    def corrected(self, W: Floats, Y: Floats, v: Floats) -> None:
        """Postpone an update: W is L^-1 H P, Y is L^-1 H `phi`, v the innovation times L^-1, S being L L^T."""
        self.phi -= W.T @ Y
        self.theta += Y.T @ Y
        self.shift += Y.T @ v

    def carry_out(self, state: Floats, cov: Floats) -> None:
        """Write the present values of all into a state (n,) and a covariance (n, n)."""
        G = cov[self.rows]
        state += G.T @ self.shift
        state[self.rows] = self.state
        values, vectors = np.linalg.eigh(self.theta)
        W = (np.sqrt(np.maximum(values, 0)) * vectors).T @ G
        for start in range(0, len(cov), BLOCK):
            rows, so_far = slice(start, start + BLOCK), slice(0, start + BLOCK)
            cov[rows, so_far] -= W[:, rows].T @ W[:, so_far]
            cov[:start, rows] = cov[rows, :start].T
        present = self.phi @ G
        present[:, self.rows] = self.cov
        cov[self.rows] = present
        cov[:, self.rows] = present.T


class PoseMapEkf:
    """State and covariance of the robot and its map, the robot first, in arrays with room to grow.

    Maps consist of elements of `width` variables each, observed by two angles each.
    """

    width: int
    postpones = False  # whether updates of a part of a large map are kept apart

    def __init__(self, settings: Gate, pose: Floats, covariance: Floats) -> None:
        self._settings, self._size = settings, 3
        self._state, self._cov = np.zeros(3 + ROOM), np.zeros((3 + ROOM, 3 + ROOM))
        self._state[:3], self._cov[:3, :3] = pose, covariance
        self._active: Active | None = None
        self._trajectory: list[Floats] = [self._state[:3].copy()]

    @property
    def variables(self) -> int:
        """How many variables are estimated."""
        return self._size

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`; Gil et al. (2012), eq. 4 and 6."""
        warnings = check_motion(motion, covariance, len(self._trajectory))
        if not warnings:
            x, P = self._present()
            before = x[:3].copy()
            x[:3] = moved(before, motion)
            dx, dy = x[:2] - before[:2]
            F, G = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1.0]]), planar_rotation(before[2])
            P[:3, 3:] = F @ P[:3, 3:]
            P[3:, :3] = P[:3, 3:].T
            robot = F @ P[:3, :3] @ F.T + G @ covariance @ G.T
            P[:3, :3] = (robot + robot.T) / 2
            if self._active:
                self._active.phi[:3] = F @ self._active.phi[:3]
        self._trajectory.append(self._present()[0][:3].copy())
        return warnings

    def rows(self, elements: Ints) -> Ints:
        """The rows (K, width) of elements (K,) of the map in the state."""
        return np.asarray(3 + self.width * elements[:, None] + np.arange(self.width))

    def update(self, rows: Ints, v: Floats, J_robot: Floats, J_own: Floats, R: Floats) -> tuple[Bools, list[str]]:
        """Update by K observations of two angles each, of elements at rows (K, width): which are believed, and warnings.

        Innovations v are (K, 2), their Jacobians by the robot's pose (K, 2, 3), and by the elements (K, 2, width), the
        noise R is (K, 2, 2). Each is gated by itself; all that are believed are taken at once (Gil et al., 2012, eq. 7 to 11).
        """
        x, P, at = self._concerned(rows)
        used, H = self._jacobian(at, J_robot, J_own)
        PHt = P[:, used] @ H.T
        S = H @ PHt[used]
        k = np.arange(len(rows))
        S.reshape(len(rows), 2, len(rows), 2)[k, :, k] += R
        S = (S + S.T) / 2
        inside = mahalanobis(v, diagonal_blocks(S)) <= self._settings.gate
        warnings = []
        if inside.any() and not self._correct(x, P, PHt, S, v, inside, used, H):
            step = len(self._trajectory) - 1
            warnings.append(
                f"step {step}: the covariance is not positive definite; the step's observations are left out"
            )
            inside[:] = False
        self._trajectory[-1] = x[:3].copy()
        return inside, warnings

    def _present(self) -> tuple[Floats, Floats]:
        """State (a,) and covariance (a, a), to be changed in place: of the part that is observed, else of all."""
        if self._active:
            return self._active.state, self._active.cov
        return self._state[: self._size], self._cov[: self._size, : self._size]

    def _concerned(self, rows: Ints) -> tuple[Floats, Floats, Ints]:
        """State and covariance as `_present`, of a part that has these rows (K, width) or of all, and where they are in it."""
        if not self.postpones or self._size <= max(DENSE, 4 * rows.size):
            self._carry_out()
            return *self._present(), rows
        if self._active and len(self._active.rows) + (self._active.places(rows) < 0).sum() > MOST_ACTIVE:
            self._carry_out()
        if not self._active:
            self._active = Active(self._state, self._cov)
        new = np.unique(rows[self._active.places(rows) < 0])
        if len(new):
            self._active.join(new, self._state, self._cov)
        return *self._present(), self._active.places(rows)

    def _carry_out(self) -> None:
        """Carry out what has been postponed."""
        if self._active:
            self._active.carry_out(self._state[: self._size], self._cov[: self._size, : self._size])
            self._active = None

    def _present_state(self) -> Floats:
        """The whole state (n,) as it is now, a copy."""
        state = self._state[: self._size].copy()
        if self._active:
            state += self._active.shift @ self._cov[self._active.rows, : self._size]
            state[self._active.rows] = self._active.state
        return state

    def _jacobian(self, rows: Ints, J_robot: Floats, J_own: Floats) -> tuple[Ints, Floats]:
        """The columns (c,) of H that are not zero, the robot's and those of elements at rows (K, width), and these (2K, c)."""
        count, width = len(rows), self.width
        k = np.arange(count)
        H = np.zeros((count, 2, 3 + width * count))
        H[:, :, :3] = J_robot
        H[:, :, 3:].reshape(count, 2, count, width)[k, :, k] = J_own
        return np.concatenate([np.arange(3), rows.ravel()]), H.reshape(2 * count, -1)

    def _correct(
        self, x: Floats, P: Floats, PHt: Floats, S: Floats, v: Floats, inside: Bools, used: Ints, H: Floats
    ) -> bool:
        """Gain and update by the observations inside the gate; False, and nothing changed, where P is no covariance."""
        both = np.repeat(inside, 2)
        try:
            L = np.linalg.cholesky(S[both][:, both])
        except np.linalg.LinAlgError:
            return False
        solved = np.linalg.solve(L, np.column_stack([PHt[:, both].T, v[inside].ravel()]))
        W = solved[:, :-1]  # L^-1 H P: K S K^T is W^T W, symmetric to the last bit
        if (np.diagonal(P) < (W * W).sum(axis=0)).any():
            return False
        x += W.T @ solved[:, -1]
        x[2] = wrap_angle(x[2])
        P -= W.T @ W
        if self._active:
            self._active.corrected(W, np.linalg.solve(L, H[both] @ self._active.phi[used]), solved[:, -1])
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
        x, P = self._present()
        return x[:3].copy(), P[:3, :3].copy()

    def element_covariances(self) -> Floats:
        """The covariances (N, width, width) of the elements."""
        self._carry_out()
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
