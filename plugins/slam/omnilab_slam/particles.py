"""Particles of FastSLAM on maps of views: each a trajectory of the robot, with views known given that trajectory."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import wrap_angle
from omnilab_slam.view_model import Gate, check_motion, mahalanobis, predict_angles, usable

ROOM = 16  # views that there is room for at first; doubled when it is full
LEAST_SHARE = 0.5  # of the particles that count: with fewer, they are drawn anew
FLOOR = np.diag([1e-6, 1e-6, 1e-6]) ** 2  # m², rad²: added to covariances, as particles that are all one have none


class ParticleMap:
    """M particles with weights: a Gaussian of the robot's pose, poses of views, and the covariances of these.

    With `look_first` the pose is drawn after the observations of a step, from what they make of it; without, before them.
    """

    def __init__(
        self, gate: Gate, particles: int, seed: int, look_first: bool, pose: Floats, covariance: Floats
    ) -> None:
        self._gate, self._look_first, self._rng = gate, look_first, np.random.default_rng(seed)
        self._poses, self._spread = np.tile(pose, (particles, 1)), np.tile(covariance, (particles, 1, 1))
        self._weights = np.full(particles, 1 / particles)
        self._count = 0
        self._views, self._covariances = np.zeros((particles, ROOM, 3)), np.zeros((particles, ROOM, 3, 3))
        self._past: list[Floats] = []  # poses (M, 3) of the particles at each step before this one
        self._parents: list[Ints] = []  # which particle of the step before each of them came from
        self._parent: Ints = np.arange(particles)  # and those of the present step
        if not look_first:
            self._draw_poses()

    @property
    def variables(self) -> int:
        """How many variables are estimated."""
        return self._poses.size + self._views[:, : self._count].size

    def predict(self, motion: Floats, covariance: Floats) -> list[str]:
        """See `omnilab.api.ViewMap`. Each particle takes a motion of its own."""
        warnings = check_motion(motion, covariance, len(self._past) + 1)
        self._end_step()
        if not warnings:
            c, s = np.cos(self._poses[:, 2]), np.sin(self._poses[:, 2])
            G = np.zeros((len(c), 3, 3))
            G[:, 0, 0], G[:, 0, 1], G[:, 1, 0], G[:, 1, 1], G[:, 2, 2] = c, -s, s, c, 1
            self._poses, self._spread = self._poses + G @ motion, G @ covariance @ G.transpose(0, 2, 1)
            if not self._look_first:
                self._draw_poses()
        return warnings

    def _end_step(self) -> None:
        """The poses of the present step become those of a past one."""
        self._draw_poses()
        self._past.append(self._poses)
        self._parents.append(self._parent)
        self._parent = np.arange(len(self._poses))

    def _draw_poses(self) -> None:
        """Each particle's pose, from its Gaussian."""
        if self._spread.any():
            values, axes = np.linalg.eigh(self._spread)
            z = np.sqrt(np.maximum(values, 0)) * self._rng.standard_normal(self._poses.shape)
            self._poses = self._poses + (axes @ z[:, :, None])[:, :, 0]
            self._spread = np.zeros_like(self._spread)

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, list[str]]:
        """See `omnilab.api.ViewMap`. Weights are the likelihoods of the observations; each is gated by all particles together."""
        mean, step = self.pose()[0], len(self._past)
        predicted = predict_angles(mean, self.views()[views])
        believed, warnings = usable(views, predicted, angles_rad, covariances, self._gate.nearest_m, step)
        for k in np.flatnonzero(believed):
            believed[k] = self._explains(int(views[k]), angles_rad[k], covariances[k])
        log_weights = np.log(np.maximum(self._weights, 1e-300))
        for k in np.flatnonzero(believed):
            log_weights += self._weigh(int(views[k]), angles_rad[k], covariances[k])
        self._draw_poses()
        for k in np.flatnonzero(believed):
            self._update_view(int(views[k]), angles_rad[k], covariances[k])
        weights = np.exp(log_weights - log_weights.max())
        self._weights = weights / weights.sum()
        if 1 / (self._weights**2).sum() < LEAST_SHARE * len(self._weights):
            self._resample()
        return believed, warnings

    def _innovation(self, view: int, angles_rad: Floats, R: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Innovations (M, 2) of a view, their covariances (M, 2, 2), and Jacobians (M, 2, 3) by the robot and by the view."""
        at = predict_angles(self._poses, self._views[:, view], self._gate.nearest_m)
        S = at.J_robot @ self._spread @ at.J_robot.transpose(0, 2, 1)
        S += at.J_view @ self._covariances[:, view] @ at.J_view.transpose(0, 2, 1) + R
        return wrap_angle(angles_rad - at.angles_rad), S, at.J_robot, at.J_view

    def _explains(self, view: int, angles_rad: Floats, R: Floats) -> bool:
        """Whether an observation is within the gate of all particles together, as one Gaussian."""
        v, S, _, _ = self._innovation(view, angles_rad, R)
        middle = v[self._weights.argmax()]
        off = wrap_angle(v - middle)
        mean = self._weights @ off
        off -= mean
        total = np.tensordot(self._weights, S + off[:, :, None] * off[:, None], 1)
        return bool(mahalanobis(wrap_angle(middle + mean)[None], total[None])[0] <= self._gate.gate)

    def _weigh(self, view: int, angles_rad: Floats, R: Floats) -> Floats:
        """Log-likelihoods (M,) of an observation; what is not yet drawn of the pose follows it (Montemerlo et al., 2003)."""
        v, S, J_robot, _ = self._innovation(view, angles_rad, R)
        solved = np.linalg.solve(S, v[:, :, None])
        if self._spread.any():
            JP = J_robot @ self._spread
            self._poses = self._poses + (JP.transpose(0, 2, 1) @ solved)[:, :, 0]
            spread = self._spread - JP.transpose(0, 2, 1) @ np.linalg.solve(S, JP)
            self._spread = (spread + spread.transpose(0, 2, 1)) / 2
        return np.asarray(-0.5 * ((v * solved[:, :, 0]).sum(axis=1) + np.log(np.linalg.det(S))))

    def _update_view(self, view: int, angles_rad: Floats, R: Floats) -> None:
        """Each particle's Kalman filter of one view. The robot's own views are certain, given its trajectory: they stay."""
        P = self._covariances[:, view]
        if P.any():
            v, S, _, J = self._innovation(view, angles_rad, R)
            JP = J @ P
            self._views[:, view] += (JP.transpose(0, 2, 1) @ np.linalg.solve(S, v[:, :, None]))[:, :, 0]
            after = P - JP.transpose(0, 2, 1) @ np.linalg.solve(S, JP)
            self._covariances[:, view] = (after + after.transpose(0, 2, 1)) / 2

    def _resample(self) -> None:
        """Draw particles anew by their weights, evenly spaced (low variance)."""
        count = len(self._weights)
        edges = np.cumsum(self._weights)
        chosen = np.searchsorted(edges / edges[-1], (np.arange(count) + self._rng.random()) / count)
        self._poses, self._spread = self._poses[chosen], self._spread[chosen]
        self._views[:, : self._count] = self._views[chosen, : self._count]
        self._covariances[:, : self._count] = self._covariances[chosen, : self._count]
        self._parent, self._weights = self._parent[chosen], np.full(count, 1 / count)

    def add_view(self) -> int:
        """See `omnilab.api.ViewMap`: given its trajectory, a particle knows for certain where it took a view."""
        self._draw_poses()
        return self._add(self._poses, np.zeros((3, 3)))

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """See `omnilab.api.ViewMap`."""
        return self._add(pose, covariance)

    def _add(self, poses: Floats, covariance: Floats) -> int:
        new = self._count
        if new == self._views.shape[1]:
            self._views = np.concatenate([self._views, np.zeros_like(self._views)], axis=1)
            self._covariances = np.concatenate([self._covariances, np.zeros_like(self._covariances)], axis=1)
        self._views[:, new], self._covariances[:, new] = poses, covariance
        self._count += 1
        return new

    def pose(self) -> tuple[Floats, Floats]:
        """See `omnilab.api.ViewMap`."""
        mean, covariance = self._moments(self._poses[:, None], self._spread[:, None])
        return mean[0], covariance[0]

    def views(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return self._moments(self._views[:, : self._count], self._covariances[:, : self._count])[0]

    def view_covariances(self) -> Floats:
        """See `omnilab.api.ViewMap`."""
        return self._moments(self._views[:, : self._count], self._covariances[:, : self._count])[1]

    def _moments(self, poses: Floats, covariances: Floats) -> tuple[Floats, Floats]:
        """Means (N, 3) and covariances (N, 3, 3) of the mixtures of poses (M, N, 3) with covariances (M, N, 3, 3)."""
        off = poses - poses[self._weights.argmax()]
        off[:, :, 2] = wrap_angle(off[:, :, 2])
        mean = np.tensordot(self._weights, off, 1)
        means = poses[self._weights.argmax()] + mean
        off -= mean
        means[:, 2] = wrap_angle(means[:, 2])
        return means, np.tensordot(self._weights, covariances + off[..., None] * off[..., None, :], 1) + FLOOR

    def finish(self) -> Floats:
        """See `omnilab.api.ViewMap`: the mean of the trajectories of the particles that there are at the end."""
        at: Ints = np.arange(len(self._poses))
        path = []
        for poses, parents in zip([*self._past, self._poses][::-1], [*self._parents, self._parent][::-1], strict=True):
            path.append(self._moments(poses[at][:, None], np.zeros((len(at), 1, 3, 3)))[0][0])
            at = parents[at]
        return np.array(path[::-1])
