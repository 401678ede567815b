"""The view EKF that postpones what it does to the rest of a large map, beside the textbook's dense equations."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab_slam import ViewEkf, ekf
from omnilab_slam.view_model import planar_rotation, predict_angles

Q, R = np.diag([4e-4, 1e-4, 1e-4]), np.array([[0.01, 0.002], [0.002, 0.01]])


class Textbook:
    """x and P in full; S, K and (I - K H) P as they are printed."""

    def __init__(self, pose, covariance):
        self.x, self.P = pose.copy(), covariance.copy()

    def predict(self, motion, covariance):
        before = self.x[:3].copy()
        self.x[:3] = moved(before, motion)
        F = np.eye(len(self.x))
        F[:2, 2] = -(self.x[1] - before[1]), self.x[0] - before[0]
        self.P = F @ self.P @ F.T
        self.P[:3, :3] += planar_rotation(before[2]) @ covariance @ planar_rotation(before[2]).T

    def add_view(self):
        G = np.vstack([np.eye(len(self.x)), np.eye(3, len(self.x))])
        self.x, self.P = G @ self.x, G @ self.P @ G.T

    def know_view(self, pose, covariance):
        self.x, self.P = np.append(self.x, pose), np.pad(self.P, (0, 3))
        self.P[-3:, -3:] = covariance

    def observe(self, views, angles):
        predicted = predict_angles(self.x[:3], self.x[3:].reshape(-1, 3)[views])
        H = np.zeros((2 * len(views), len(self.x)))
        for k, view in enumerate(views):
            H[2 * k : 2 * k + 2, :3] = predicted.J_robot[k]
            H[2 * k : 2 * k + 2, 3 + 3 * view : 6 + 3 * view] = predicted.J_view[k]
        S = H @ self.P @ H.T + np.kron(np.eye(len(views)), R)
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ wrap_angle(angles - predicted.angles_rad).ravel()
        self.x[2] = wrap_angle(self.x[2])
        self.P = (np.eye(len(self.x)) - K @ H) @ self.P


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), most=st.integers(3, 60), steps=st.integers(5, 40))
def test_postponed_updates_are_those_of_the_dense_equations(seed, most, steps):
    rng = np.random.default_rng(seed)
    with patch.object(ekf, "DENSE", 0), patch.object(ekf, "MOST_ACTIVE", most), patch.object(ekf, "BLOCK", 16):
        found, dense = (
            make(np.zeros(3), 1e-4 * np.eye(3))
            for make in (ViewEkf(gate_probability=1, nearest_m=0.05).begin, Textbook)
        )
        count = 0
        for _ in range(steps):
            motion = np.array([rng.uniform(0.5, 1), 0, rng.uniform(-0.5, 0.5)])
            found.predict(motion, Q)
            dense.predict(motion, Q)
            far = np.flatnonzero(np.linalg.norm(dense.x[3:].reshape(-1, 3)[:, :2] - dense.x[:2], axis=1) > 0.3)
            if len(far):
                views = rng.permutation(far)[: rng.integers(1, 4)]
                exact = predict_angles(dense.x[:3], dense.x[3:].reshape(-1, 3)[views]).angles_rad
                angles = wrap_angle(exact + 0.05 * rng.standard_normal(exact.shape))
                believed, warnings = found.observe(views, angles, np.tile(R, (len(views), 1, 1)))
                assert believed.all()
                assert not warnings
                dense.observe(views, angles)
            if rng.random() < 0.2:
                known = rng.uniform(-5, 5, 3)
                found.know_view(known, 0.01 * np.eye(3))
                dense.know_view(known, 0.01 * np.eye(3))
                count += 1
            if rng.random() < 0.7:
                found.add_view()
                dense.add_view()
                count += 1
        poses = dense.x[3:].reshape(-1, 3)
        assert np.allclose(found.pose()[0], dense.x[:3], atol=1e-7)
        assert np.allclose(found.pose()[1], dense.P[:3, :3], atol=1e-9)
        assert np.allclose(found.views()[:, :2], poses[:, :2], atol=1e-7)
        assert np.allclose(wrap_angle(found.views()[:, 2] - poses[:, 2]), 0, atol=1e-7)
        blocks = dense.P[3:, 3:].reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
        assert np.allclose(found.view_covariances(), blocks, atol=1e-9)
        assert np.allclose(found.views()[:, :2], poses[:, :2], atol=1e-7)  # also once all has been carried out
        assert np.array_equal(found._cov, found._cov.T)
