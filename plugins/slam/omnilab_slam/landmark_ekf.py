"""SLAM with landmarks by an extended Kalman filter, in inverse depth (Civera et al., 2008)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bools, Floats, Ints, setting
from omnilab.geometry import wrap_angle
from omnilab_slam.ekf import PoseMapEkf
from omnilab_slam.landmark_model import positions, predict_directions
from omnilab_slam.view_model import Gate, check_pose, is_covariance

STRAIGHT_UP = 1e-3  # a direction that is nearer to the vertical has no azimuth
UNSEEN_RAD = 1.0  # standard deviation of the direction of a landmark that has not been observed yet


@dataclass
class LandmarkEkf(Gate):
    """Extended Kalman filter over the robot's pose and the points that it sees, in inverse depth (Civera et al., 2008).

    It observes landmarks, not views: points of the world by their azimuth and elevation. Of the six variables of a landmark
    in print five are left, for the camera stays at one height. It is a view filter for comparison: `add_view` takes a
    landmark, which its first observation places on a ray; `views` are positions, z over the camera. The inverse distance
    begins at 1 / (2 nearest_m) with half of that as its standard deviation: two of them reach from `nearest_m` to infinity.
    """

    nearest_m: float = setting(1.0, above=0)  # hardly any landmark is nearer to the robot when it is first observed

    observes: ClassVar[str] = "landmarks"

    def begin(self, pose: Floats, covariance: Floats) -> LandmarkMap:
        """A map without landmarks, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return LandmarkMap(self, pose, covariance)


class LandmarkMap(PoseMapEkf):
    """The robot and the landmarks: anchor x and y, azimuth, elevation and inverse distance of each."""

    width = 5

    def __init__(self, settings: Gate, pose: Floats, covariance: Floats) -> None:
        super().__init__(settings, pose, covariance)
        self._seen = np.zeros(0, bool)  # which landmarks have been observed

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`: landmarks by azimuth and elevation. Those observed first are placed on their rays."""
        step = len(self._trajectory) - 1
        sound = np.isfinite(angles_rad).all(axis=1) & is_covariance(covariances)
        warnings = [
            f"step {step}: landmark {k} has a direction that is no number or no covariance; it is left out"
            for k in views[~sound]
        ]
        believed = sound & self._seen[views]
        if believed.any():
            at = np.flatnonzero(believed)
            believed[at], more = self._observe_again(views[at], angles_rad[at], covariances[at])
            warnings += more
        for k in np.flatnonzero(sound & ~self._seen[views]):
            believed[k] = True
            self._place(int(views[k]), angles_rad[k], covariances[k])
        return believed, warnings

    def _observe_again(self, landmarks: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """Which of the landmarks (K,) are believed; straight above, none is."""
        rows = self.rows(landmarks)
        predicted = predict_directions(self._state[:3], self._state[rows])
        believed, warnings = predicted.level > STRAIGHT_UP, list[str]()
        if believed.any():
            fit = np.flatnonzero(believed)
            v = wrap_angle(angles_rad - predicted.angles_rad)
            believed[fit], warnings = self.update(
                rows[fit], v[fit], predicted.J_robot[fit], predicted.J_landmark[fit], covariances[fit]
            )
        return believed, warnings

    def add_view(self) -> int:
        """See `omnilab.api.ViewMap`: a landmark, somewhere about the robot until it is observed."""
        self._seen = np.append(self._seen, False)
        self.grow()
        self._place(len(self._seen) - 1, np.zeros(2), UNSEEN_RAD**2 * np.eye(2))
        self._seen[-1] = False
        return len(self._seen) - 1

    def _place(self, landmark: int, angles_rad: Floats, covariance: Floats) -> None:
        """A landmark on the ray in which it is seen from where the robot is (Civera et al., 2008, eq. 20 to 25)."""
        (rows,), P = self.rows(np.array([landmark])), self._cov
        rho = 1 / (2 * self._settings.nearest_m)
        x, y, heading = self._state[:3]
        self._state[rows] = [x, y, heading + angles_rad[0], angles_rad[1], rho]
        n, J = self._size, np.zeros((5, 3))
        J[:3, :3] = np.eye(3)
        own = J @ P[:3, :3] @ J.T
        own[2:4, 2:4] += covariance
        own[4, 4] = (rho / 2) ** 2
        P[rows, :n] = J @ P[:3, :n]
        P[:n, rows] = P[rows, :n].T
        P[np.ix_(rows, rows)] = own
        self._seen[landmark] = True

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """See `omnilab.api.ViewMap`: a landmark at a position (3,), z over the camera, with its covariance (3, 3).

        Its ray begins where the robot is thought to be now, which is part of what it is described by and not uncertain.
        """
        check_pose("a landmark", pose, covariance)
        self._seen = np.append(self._seen, True)
        new, at = self.grow(), self._state[:2].copy()
        x, y, z = pose - [*at, 0]
        level, distance = np.hypot(x, y), np.linalg.norm([x, y, z])
        self._state[new] = [*at, np.arctan2(y, x), np.arctan2(z, level), 1 / distance]
        _, J = positions(self._state[new][None])
        inverse = np.linalg.inv(J[0, :, 2:])
        self._cov[new, new][2:, 2:] = inverse @ covariance @ inverse.T
        return len(self._seen) - 1

    def views(self) -> Floats:
        """The positions (N, 3) of the landmarks, z over the camera."""
        return positions(self._state[3 : self._size].reshape(-1, self.width))[0]

    def view_covariances(self) -> Floats:
        """Their covariances (N, 3, 3)."""
        _, J = positions(self._state[3 : self._size].reshape(-1, self.width))
        P = J @ self.element_covariances() @ J.transpose(0, 2, 1)
        return np.asarray((P + P.transpose(0, 2, 1)) / 2)
