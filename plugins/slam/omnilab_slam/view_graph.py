"""View-based SLAM by a factor graph, solved incrementally (iSAM2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np

from omnilab.api import Bools, Floats, Ints, setting
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam.factors import factor_of, pose_of, poses_of, vector_of
from omnilab_slam.solvers import FAILURES, brief, empty_tree, is_singular, levenberg_marquardt
from omnilab_slam.view_factor import noise_of_covariance, view_factor
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

KNOWN = 1 << 62  # views from before have numbers from here on: those of the trajectory's poses are the steps
LOOSE = np.eye(3)  # m², rad²: of the motion to a pose whose update failed
MAX_ITERATIONS, TOLERANCE = 100, 1e-6  # of the last solution


@dataclass
class ViewGraph(Gate):
    """Factor graph of all the robot's poses, of which some are views: motions, bearings and relative orientations.

    iSAM2 (Kaess et al., 2012) solves it step by step, by Cholesky and, once that has failed, by QR, and linearises anew what has
    moved. Where a robot that has
    been lost observes a view again, bearings are far from linear: an update that does not explain its observations has the
    whole graph solved (Levenberg-Marquardt), as `finish` does. Observations are gated by the covariance that the graph
    predicts, and poses are kept `nearest_m` from the views that they observe.
    """

    surprise: float = setting(
        9.0, at_least=0
    )  # squared Mahalanobis distance of an observation after its update that has the whole graph solved
    relinearize_threshold: float = setting(
        0.1, at_least=0
    )  # m and rad that a pose may move before its factors are linearised anew
    relinearize_every: int = setting(10, at_least=1)  # updates; a step has one for its motion and one for what it sees

    def begin(self, pose: Floats, covariance: Floats) -> GraphMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""
        check_pose("a robot", pose, covariance)
        return GraphMap(self, pose, covariance)


class GraphMap:
    """A Bayes tree over the trajectory's poses, by step, with its factors, from which it is rebuilt should an update fail."""

    def __init__(self, settings: ViewGraph, pose: Floats, covariance: Floats) -> None:
        import gtsam

        self._settings, self._step, self._views = settings, 0, list[int]()
        self._factors = gtsam.NonlinearFactorGraph()
        self._factorization, self._notes = "CHOLESKY", list[str]()
        self._tree = self._empty_tree()
        self._add_prior(0, pose, covariance)

    @property
    def variables(self) -> int:
        """How many variables are estimated: the poses of all steps, and of views from before."""
        return 3 * (self._step + 1 + sum(node >= KNOWN for node in self._views))

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`."""
        warnings = check_motion(motion, covariance, self._step + 1)
        if warnings:
            motion, covariance = np.zeros(3), np.zeros((3, 3))
        guess = moved(self._pose(self._step), motion)
        new = self._step + 1
        try:
            self._update([factor_of(self._step, new, motion, noise_of_covariance(covariance))], {new: guess})
        except FAILURES as error:
            self._rebuild()
            self._update([factor_of(self._step, new, motion, noise_of_covariance(LOOSE))], {new: guess})
            warnings.append(
                f"step {new}: the motion could not be added ({brief(error)}); the robot is where it was guessed"
            )
        self._step = new
        return warnings + self._warnings()

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`."""
        nodes = [self._views[view] for view in views]
        predicted = predict_angles(self._pose(self._step), self._poses(nodes))
        believed, warnings = usable(views, predicted, angles_rad, covariances, self._settings.nearest_m, self._step)
        if not believed.any():
            return believed, warnings
        before = self._factors.size()
        try:
            fit = np.flatnonzero(believed)
            S = covariances[fit] + self._predicted_covariances([nodes[k] for k in fit], predicted.at(fit))
            v = wrap_angle(angles_rad[fit] - predicted.angles_rad[fit])
            believed[fit] = mahalanobis(v, S) <= self._settings.gate
            factors = [
                view_factor(self._step, nodes[k], angles_rad[k], covariances[k], self._settings.nearest_m)
                for k in np.flatnonzero(believed)
            ]
            self._update(factors, {})
            if self._unexplained(
                [nodes[k] for k in np.flatnonzero(believed)], angles_rad[believed], covariances[believed]
            ):
                warnings += self._solve()
        except FAILURES as error:
            self._factors.resize(before)
            self._rebuild()
            believed[:] = False
            warnings.append(
                f"step {self._step}: the observations could not be added ({brief(error)}); they are left out"
            )
        return believed, warnings + self._warnings()

    def _unexplained(self, nodes: list[int], angles_rad: Floats, covariances: Floats) -> bool:
        """Whether an update leaves its observations farther off than `surprise`: it was far from linear."""
        predicted = predict_angles(self._pose(self._step), self._poses(nodes))
        v = wrap_angle(angles_rad - predicted.angles_rad)
        return bool((mahalanobis(v, covariances) > self._settings.surprise).any())

    def _predicted_covariances(self, nodes: list[int], predicted: PredictedAngles) -> Floats:
        """Covariances (K, 2, 2) of the predicted observations of nodes, from the joint ones of the robot with each."""
        keys = sorted({self._step, *nodes})
        joint = self._surely(lambda: self._tree.jointMarginalCovariance(keys).fullMatrix())
        joint = joint.reshape(len(keys), 3, len(keys), 3)
        r, k = keys.index(self._step), np.array([keys.index(node) for node in nodes])
        frames = [
            planar_rotation(self._pose(node)[2]) for node in (self._step, *nodes)
        ]  # of the marginals: each pose's own
        A, B = predicted.J_robot @ frames[0], predicted.J_view @ np.array(frames[1:])
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
        self._add_prior(KNOWN + len(self._views), pose, covariance)
        self._views.append(KNOWN + len(self._views))
        return len(self._views) - 1

    def pose(self) -> tuple[Floats, Floats]:
        """See `omnilab.api.ViewMap`."""
        return self._pose(self._step), self._covariance(self._step)

    def views(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return self._poses(self._views)

    def view_covariances(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return np.array([self._covariance(node) for node in self._views]).reshape(-1, 3, 3)

    def finish(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        start = self._tree.calculateEstimate()
        solved = levenberg_marquardt(self._factors, start, MAX_ITERATIONS, TOLERANCE)
        for sentence in solved.warnings:
            warn(f"the whole graph of views: {sentence}", stacklevel=2)
        return poses_of(solved.values, planar=True)[: self._step + 1]

    def _add_prior(self, node: int, pose: Floats, covariance: Floats) -> None:
        """A prior factor: one more node at a pose (3,) known with a covariance (3, 3)."""
        import gtsam

        to_own = planar_rotation(-pose[2])
        prior = gtsam.PriorFactorPose2(node, pose_of(pose), noise_of_covariance(to_own @ covariance @ to_own.T))
        self._update([prior], {node: pose})

    def _pose(self, node: int) -> Floats:
        return vector_of(self._tree.calculateEstimatePose2(node))

    def _poses(self, nodes: list[int]) -> Floats:
        """Poses (N, 3)."""
        return np.array([self._pose(node) for node in nodes]).reshape(-1, 3)

    def _covariance(self, node: int) -> Floats:
        """The marginal covariance (3, 3) of a pose, in the world's frame."""
        to_world = planar_rotation(float(self._pose(node)[2]))
        covariance = to_world @ self._surely(lambda: self._tree.marginalCovariance(node)) @ to_world.T
        return np.asarray((covariance + covariance.T) / 2)

    def _empty_tree(self) -> Any:
        return empty_tree(self._settings.relinearize_threshold, self._settings.relinearize_every, self._factorization)

    def _surely(self, action: Callable[[], Any]) -> Any:
        """What an action on the tree returns; should Cholesky fail, of a tree that is built again by QR, and stays so."""
        try:
            return action()
        except FAILURES as error:
            self._leave_cholesky(error)
            self._rebuild()
            return action()

    def _leave_cholesky(self, error: Exception) -> None:
        """From here on by QR; the error itself where that is no remedy."""
        if self._factorization == "QR" or not is_singular(error):
            raise error
        self._factorization = "QR"
        self._notes.append(f"step {self._step}: Cholesky fails: from here on iSAM2 solves by QR, which takes longer")

    def _warnings(self) -> list[str]:
        """What has happened since this was asked, in sentences."""
        warnings, self._notes = self._notes, []
        return warnings

    def _update(self, factors: list[Any], poses: dict[int, Floats]) -> None:
        import gtsam

        new, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for factor in factors:
            new.push_back(factor)
        for node, pose in poses.items():
            values.insert(node, pose_of(pose))
        self._surely(lambda: self._tree.update(new, values))
        self._factors.push_back(new)

    def _solve(self) -> list[str]:
        """Solve the whole graph by Levenberg-Marquardt and rebuild the tree from that; warnings."""
        solved = levenberg_marquardt(self._factors, self._tree.calculateEstimate(), MAX_ITERATIONS, TOLERANCE)
        self._plant(solved.values)
        return [f"step {self._step}: {sentence}" for sentence in solved.warnings]

    def _rebuild(self) -> None:
        """A new tree of what the old one held: a failed update breaks GTSAM's for good."""
        values = self._tree.getLinearizationPoint()
        if values.exists(self._step + 1):
            values.erase(self._step + 1)
        self._plant(values)

    def _plant(self, values: Any) -> None:
        """A new tree of all factors, linearised at these values."""
        self._tree = self._empty_tree()
        try:
            self._tree.update(self._factors, values)
        except FAILURES as error:
            self._leave_cholesky(error)
            self._plant(values)
