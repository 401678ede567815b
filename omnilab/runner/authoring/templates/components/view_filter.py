"""A view filter: an extended Kalman filter over the robot and its views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from omnilab import (
    Bools,
    DataError,
    Floats,
    Ints,
    ViewFilter,
    ViewMap,
    check_settings,
    setting,
)
from omnilab.geometry import wrap_angle


@dataclass
class MyViewFilter:
    """An extended Kalman filter over the poses of the robot and of all views.

    Each observation is believed if its squared Mahalanobis distance is below the gate, and
    corrects the whole map at once (Gil et al., 2012, eq. 1 to 12). The time of a step
    grows with the square of the number of views.
    """

    gate: float = setting(13.8, above=0)  # 99.9 % of sound observations lie below

    def __post_init__(self) -> None:
        check_settings(self)

    def begin(self, pose: Floats, covariance: Floats) -> "KalmanMap":
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        if not np.isfinite([*pose, *np.ravel(covariance)]).all():
            raise DataError(f"the robot cannot start at {pose}; give finite numbers")
        return KalmanMap(self.gate, pose, covariance)


class KalmanMap:
    """The state: x, y and heading of the robot, then of each view; and its covariance."""

    def __init__(self, gate: float, pose: Floats, covariance: Floats) -> None:
        self._gate, self._x, self._P = gate, pose.astype(float), covariance.copy()
        self._trajectory = [self._x.copy()]

    def predict(self, motion: Floats, covariance: Floats) -> Sequence[str]:
        """The robot moved by (3,), in its own frame, with covariance (3, 3)."""
        warnings = []
        if np.isfinite(motion).all() and np.isfinite(covariance).all():
            c, s = np.cos(self._x[2]), np.sin(self._x[2])
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            step = turn @ motion
            F = np.eye(len(self._x))  # the derivative of the new state by the old one
            F[:2, 2] = -step[1], step[0]
            self._x[:3] += step
            self._x[2] = wrap_angle(self._x[2])
            self._P = F @ self._P @ F.T
            self._P[:3, :3] += turn @ covariance @ turn.T
        else:
            step_number = len(self._trajectory)
            warnings.append(f"step {step_number}: no motion is known, the robot stays")
        self._trajectory.append(self._x[:3].copy())
        return warnings

    def observe(
        self, views: Ints, angles_rad: Floats, covariances: Floats
    ) -> tuple[Bools, Sequence[str]]:
        """Bearings and relative orientations (K, 2) of views (K,): which it believes."""
        observations = zip(views, angles_rad, covariances, strict=True)
        believed = [self._correct(int(v), angles, R) for v, angles, R in observations]
        self._trajectory[-1] = self._x[:3].copy()
        return np.array(believed, bool), []

    def _correct(self, view: int, angles_rad: Floats, R: Floats) -> bool:
        """Take one observation; False, and nothing changed, where it is not believed."""
        at = 3 + 3 * view
        dx, dy = self._x[at : at + 2] - self._x[:2]
        squared = dx * dx + dy * dy
        if squared < 1e-6:  # it stands on the view, which then has no bearing
            return False
        expected = np.array([np.arctan2(dy, dx), self._x[at + 2]]) - self._x[2]
        innovation = wrap_angle(angles_rad - expected)
        H = np.zeros((2, len(self._x)))
        H[0, :3] = dy / squared, -dx / squared, -1
        H[0, at : at + 2] = -dy / squared, dx / squared
        H[1, [2, at + 2]] = -1, 1
        PHt = self._P @ H.T
        S = H @ PHt + R
        if innovation @ np.linalg.solve(S, innovation) > self._gate:
            return False
        K = np.linalg.solve(S, PHt.T).T
        self._x += K @ innovation
        self._x[2::3] = wrap_angle(self._x[2::3])
        I_KH = np.eye(len(self._x)) - K @ H  # Joseph's form stays positive
        self._P = I_KH @ self._P @ I_KH.T + K @ R @ K.T
        return True

    def add_view(self) -> int:
        """The robot takes a view where it is: as sure, and as unsure, as it is itself."""
        return self._append(self._x[:3], self._P[:3], self._P[:3, :3])

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """A view that was taken before, at a known pose (3,) with covariance (3, 3)."""
        return self._append(pose, np.zeros((3, len(self._x))), covariance)

    def _append(self, pose: Floats, beside: Floats, own: Floats) -> int:
        """One more view, with its covariance with the rest (3, n) and its own (3, 3)."""
        self._x = np.concatenate([self._x, pose])
        self._P = np.block([[self._P, beside.T], [beside, own]])
        return len(self._x) // 3 - 2

    def pose(self) -> tuple[Floats, Floats]:
        """The robot's pose (3,) and its covariance (3, 3)."""
        return self._x[:3], self._P[:3, :3]

    def views(self) -> Floats:
        """The poses (N, 3) of the views."""
        return self._x[3:].reshape(-1, 3)

    def view_covariances(self) -> Floats:
        """Their covariances (N, 3, 3)."""
        n = len(self._x) // 3
        blocks = self._P.reshape(n, 3, n, 3)
        return blocks[np.arange(1, n), :, np.arange(1, n)]

    def finish(self) -> Floats:
        """The robot's poses (T, 3), each as it was known at its time."""
        return np.array(self._trajectory)


# a type checker compares both with the contract:
_: type[ViewFilter] = MyViewFilter
__: type[ViewMap] = KalmanMap
