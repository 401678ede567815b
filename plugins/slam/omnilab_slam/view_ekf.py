"""View-based SLAM by an extended Kalman filter (Gil et al., 2012, eq. 1 to 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab_slam.ekf import PoseMapEkf
from omnilab_slam.view_model import Gate, check_pose, predict_angles, usable


@dataclass
class ViewEkf(Gate):
    """Extended Kalman filter over the robot's pose and those of all views (Gil et al., 2012, eq. 1 to 12).

    In maps of more than 120 views the time of a step does not depend on their number, but for one now and then, when other views come
    into sight: what observations do to all other views is postponed until then (Guivant and Nebot, 2001), which is exact. What was linearised is never revised: where it is
    unsure of headings, the estimate becomes overconfident. The trajectory of `finish` is the online estimate, step by step.
    """

    def begin(self, pose: Floats, covariance: Floats) -> EkfMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return EkfMap(self, pose, covariance)


class EkfMap(PoseMapEkf):
    """The robot and the views: x, y and heading of each."""

    width, postpones = 3, True

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`; eq. 7 to 12, of all views at once. Each is gated by itself."""
        step, rows = len(self._trajectory) - 1, self.rows(views)
        state = self._present_state()
        predicted = predict_angles(state[:3], state[rows])
        believed, warnings = usable(views, predicted, angles_rad, covariances, self._settings.nearest_m, step)
        if not believed.any():
            return believed, warnings
        fit = np.flatnonzero(believed)
        predicted = predicted.at(fit)
        v = wrap_angle(angles_rad[fit] - predicted.angles_rad)
        believed[fit], more = self.update(rows[fit], v, predicted.J_robot, predicted.J_view, covariances[fit])
        return believed, warnings + more

    def add_view(self) -> int:
        """See `omnilab.api.ViewMap`."""
        n, new = self._size, self.grow()
        if self._active:
            self._active.take(np.arange(n, n + 3))
        else:
            P = self._cov
            self._state[new] = self._state[:3]
            P[new, :n], P[:n, new], P[new, new] = P[:3, :n], P[:n, :3], P[:3, :3]
        return n // 3 - 1

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """See `omnilab.api.ViewMap`."""
        check_pose("a view", pose, covariance)
        n, new = self._size, self.grow()
        self._state[new], self._cov[new, new] = pose, covariance
        return n // 3 - 1

    def views(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        poses = self._present_state()[3:].reshape(-1, 3)
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses

    def view_covariances(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return self.element_covariances()
