"""Views mapped by a factor graph that grows with the robot's way."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam.factors import check_at_least, factor_of, pose_of, poses_of, vector_of
from omnilab_slam.solvers import FAILURES, brief, levenberg_marquardt
from omnilab_slam.view_factor import noise_of, view_factor
from omnilab_slam.view_model import Gate, Seen, check_motion, check_pose, mahalanobis, see, turn, usable

KNOWN = 1 << 62  # views from before have numbers from here on: those of the way's poses are the steps
LOOSE = np.eye(3)  # m², rad²: of the motion to a pose whose update failed
MOST_ITERATIONS, TOLERANCE = 100, 1e-6  # of the last solution


@dataclass
class ViewGraph(Gate):
    """Factor graph of all the robot's poses, of which some are views: motions, bearings and relative orientations.

    iSAM2 (Kaess et al., 2012), by QR, solves it step by step, and linearises anew what has moved. Where a robot that has
    lost its way sees a view again, bearings are far from linear: an update that does not explain what it was told has the
    whole graph solved (Levenberg-Marquardt), as `finish` does. Observations are gated by the covariance that the graph
    predicts, and poses are kept `nearest_m` from the views that they observe.
    """

    surprise: float = (
        9.0  # squared Mahalanobis distance of an observation after its update that has the whole graph solved
    )
    relinearize_threshold: float = 0.1  # m and rad that a pose may move before its factors are linearised anew
    relinearize_every: int = 10  # updates; a step has one for its motion and one for what it sees

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least("surprise", self.surprise, 0, "view_filter")
        check_at_least("relinearize_threshold", self.relinearize_threshold, 0, "view_filter")
        check_at_least("relinearize_every", self.relinearize_every, 1, "view_filter")

    def begin(self, pose: Floats, covariance: Floats) -> GraphMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return GraphMap(self, pose, covariance)


class GraphMap:
    """A Bayes tree over the poses of the way, by step, and all that is needed to plant it again should an update fail."""

    def __init__(self, settings: ViewGraph, pose: Floats, covariance: Floats) -> None:
        import gtsam

        self._settings, self._step, self._views = settings, 0, list[int]()
        self._kept = gtsam.NonlinearFactorGraph()
        self._tree = self._planted()
        self._know(0, pose, covariance)

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`."""
        said = check_motion(motion, covariance, self._step + 1)
        if said:
            motion, covariance = np.zeros(3), np.zeros((3, 3))
        guess = moved(self._at(self._step), motion)
        new = self._step + 1
        try:
            self._update([factor_of(self._step, new, motion, noise_of(covariance))], {new: guess})
        except FAILURES as error:
            self._plant_again()
            self._update([factor_of(self._step, new, motion, noise_of(LOOSE))], {new: guess})
            said.append(
                f"step {new}: the motion could not be added ({brief(error)}); the robot is where it was guessed"
            )
        self._step = new
        return said

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`."""
        nodes = [self._views[view] for view in views]
        seen = see(self._at(self._step), self._all(nodes))
        believed, said = usable(views, seen, angles_rad, covariances, self._settings.nearest_m, self._step)
        if not believed.any():
            return believed, said
        before = self._kept.size()
        try:
            fit = np.flatnonzero(believed)
            S = covariances[fit] + self._spread([nodes[k] for k in fit], seen.at(fit))
            v = wrap_angle(angles_rad[fit] - seen.angles_rad[fit])
            believed[fit] = mahalanobis(v, S) <= self._settings.gate
            factors = [
                view_factor(self._step, nodes[k], angles_rad[k], covariances[k], self._settings.nearest_m)
                for k in np.flatnonzero(believed)
            ]
            self._update(factors, {})
            if self._missed([nodes[k] for k in np.flatnonzero(believed)], angles_rad[believed], covariances[believed]):
                said += self._solve()
        except FAILURES as error:
            self._kept.resize(before)
            self._plant_again()
            believed[:] = False
            said.append(f"step {self._step}: the observations could not be added ({brief(error)}); they are left out")
        return believed, said

    def _missed(self, nodes: list[int], angles_rad: Floats, covariances: Floats) -> bool:
        """Whether an update leaves its observations farther off than they may be: it was far from linear."""
        seen = see(self._at(self._step), self._all(nodes))
        v = wrap_angle(angles_rad - seen.angles_rad)
        return bool((mahalanobis(v, covariances) > self._settings.surprise).any())

    def _spread(self, nodes: list[int], seen: Seen) -> Floats:
        """Covariances (K, 2, 2) of what it should see at nodes, from those of the robot with each."""
        keys = sorted({self._step, *nodes})
        joint = self._tree.jointMarginalCovariance(keys).fullMatrix().reshape(len(keys), 3, len(keys), 3)
        r, k = keys.index(self._step), np.array([keys.index(node) for node in nodes])
        frames = [turn(self._at(node)[2]) for node in (self._step, *nodes)]  # of the marginals: each pose's own
        A, B = seen.by_robot @ frames[0], seen.by_view @ np.array(frames[1:])
        cross = A @ joint[r, :, k] @ B.transpose(0, 2, 1)
        own = A @ joint[r, :, r] @ A.transpose(0, 2, 1) + B @ joint[k, :, k] @ B.transpose(0, 2, 1)
        return np.asarray(own + cross + cross.transpose(0, 2, 1))

    def add_view(self) -> int:
        """See `omnilab.api.ViewMap`."""
        self._views.append(self._step)
        return len(self._views) - 1

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """See `omnilab.api.ViewMap`."""
        check_pose("a view", pose, covariance)
        self._know(KNOWN + len(self._views), pose, covariance)
        self._views.append(KNOWN + len(self._views))
        return len(self._views) - 1

    def pose(self) -> tuple[Floats, Floats]:
        """See `omnilab.api.ViewMap`."""
        return self._at(self._step), self._covariance(self._step)

    def views(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return self._all(self._views)

    def view_covariances(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return np.array([self._covariance(node) for node in self._views]).reshape(-1, 3, 3)

    def finish(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        start = self._tree.calculateEstimate()
        solved = levenberg_marquardt(self._kept, start, MOST_ITERATIONS, TOLERANCE)
        for sentence in solved.warnings:
            warnings.warn(f"the whole graph of views: {sentence}", stacklevel=2)
        return poses_of(solved.values, planar=True)[: self._step + 1]

    def _know(self, node: int, pose: Floats, covariance: Floats) -> None:
        """A node more, at a pose that is known by itself."""
        import gtsam

        to_own = turn(-pose[2])
        prior = gtsam.PriorFactorPose2(node, pose_of(pose), noise_of(to_own @ covariance @ to_own.T))
        self._update([prior], {node: pose})

    def _at(self, node: int) -> Floats:
        return vector_of(self._tree.calculateEstimatePose2(node))

    def _all(self, nodes: list[int]) -> Floats:
        """Poses (N, 3)."""
        return np.array([self._at(node) for node in nodes]).reshape(-1, 3)

    def _covariance(self, node: int) -> Floats:
        """Of a pose, in the world's frame."""
        to_world = turn(float(self._at(node)[2]))
        found = to_world @ self._tree.marginalCovariance(node) @ to_world.T
        return np.asarray((found + found.T) / 2)

    def _planted(self) -> Any:
        import gtsam

        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(self._settings.relinearize_threshold)
        parameters.relinearizeSkip = self._settings.relinearize_every
        return gtsam.ISAM2(parameters)

    def _update(self, factors: list[Any], poses: dict[int, Floats]) -> None:
        import gtsam

        new, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for factor in factors:
            new.push_back(factor)
        for node, pose in poses.items():
            values.insert(node, pose_of(pose))
        self._tree.update(new, values)
        self._kept.push_back(new)

    def _solve(self) -> list[str]:
        """The whole graph solved from where it is, and a tree of that. What went wrong."""
        solved = levenberg_marquardt(self._kept, self._tree.calculateEstimate(), MOST_ITERATIONS, TOLERANCE)
        self._tree = self._planted()
        self._tree.update(self._kept, solved.values)
        return [f"step {self._step}: {sentence}" for sentence in solved.warnings]

    def _plant_again(self) -> None:
        """A failed update breaks GTSAM's tree for good: a new one, of what the old one held."""
        values = self._tree.getLinearizationPoint()
        if values.exists(self._step + 1):
            values.erase(self._step + 1)
        self._tree = self._planted()
        self._tree.update(self._kept, values)
