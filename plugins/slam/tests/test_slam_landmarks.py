"""The filter of landmarks: conformance, derivatives, the equations in full, a drive recovered, consistency, odd input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import between, moved
from omnilab.testing import check_view_filter
from omnilab_slam import LandmarkEkf
from omnilab_slam.landmark_model import positions, predict_directions

POINTS = np.array([[3.0, 1, 0.8], [-2, 3, -0.6], [-3, -2, 0.4], [1, -4, -0.9], [4, -2, 1.2], [0, 4, 0.2]])


def direction(robot, point):
    x, y = point[:2] - robot[:2]
    return np.array([np.arctan2(y, x) - robot[2], np.arctan2(point[2], np.hypot(x, y))])


def circle(steps):
    angle = 2 * np.pi * np.arange(steps + 1) / 60
    return np.column_stack([1.5 * np.cos(angle), 1.5 * np.sin(angle), wrap_angle(angle + np.pi / 2)])


def numeric(function, at, h=1e-6):
    return np.column_stack([(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))])


def test_keeps_the_contract():
    check_view_filter(LandmarkEkf())


pose = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3)).map(np.array)
landmark = st.tuples(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3), st.floats(-1.2, 1.2), st.floats(0.01, 0.15)
).map(np.array)


@settings(max_examples=30, deadline=None)
@given(robot=pose, one=landmark)
def test_directions_are_those_of_the_position_and_jacobians_those_of_differences(robot, one):
    found, (at, J_at) = predict_directions(robot, one[None]), positions(one[None])
    if found.level[0] < 0.05:
        return  # nearly above the robot, where azimuths have no derivative
    assert wrap_angle(found.angles_rad[0] - direction(robot, at[0])) == pytest.approx(0, abs=1e-9)
    by_robot = numeric(lambda x: predict_directions(x, one[None]).angles_rad[0], robot)
    by_landmark = numeric(lambda x: predict_directions(robot, x[None]).angles_rad[0], one)
    assert np.allclose(found.J_robot[0], by_robot, rtol=1e-4, atol=1e-5)
    assert np.allclose(found.J_landmark[0], by_landmark, rtol=1e-4, atol=1e-5)
    assert np.allclose(J_at[0], numeric(lambda x: positions(x[None])[0][0], one), rtol=1e-4, atol=1e-4)


def test_a_point_at_infinity_shows_rotation_and_nothing_of_position():
    far = np.array([[2.0, -1, 0.7, 0.3, 0.0]])
    found = predict_directions(np.array([-4.0, 3, 0.2]), far)
    assert found.angles_rad[0] == pytest.approx([0.5, 0.3])
    assert np.allclose(found.J_robot[0], [[0, 0, -1], [0, 0, 0]])


class Naive:
    """Civera et al. (2008) in whole matrices with numeric derivatives; landmarks as in `predict_directions`."""

    def __init__(self, pose, covariance, rho):
        self.x, self.P, self.rho = np.array(pose, float), np.array(covariance, float), rho

    def predict(self, motion, covariance):
        go = lambda x, u: np.concatenate([moved(x[:3], u), x[3:]])
        F = numeric(lambda x: go(x, motion), self.x)
        G = numeric(lambda u: go(self.x, u), motion)
        self.x, self.P = go(self.x, motion), F @ self.P @ F.T + G @ covariance @ G.T

    def take(self, angles, R):
        new = lambda x, z: np.concatenate([x, [x[0], x[1], x[2] + z[0], z[1], self.rho + z[2]]])
        z = np.array([*angles, 0.0])
        F, G = numeric(lambda x: new(x, z), self.x), numeric(lambda z: new(self.x, z), z)
        noise = np.zeros((3, 3))
        noise[:2, :2], noise[2, 2] = R, (self.rho / 2) ** 2
        self.x, self.P = new(self.x, z), F @ self.P @ F.T + G @ noise @ G.T

    def observe(self, which, angles, R):
        h = lambda x: np.concatenate(
            [predict_directions(x[:3], x[None, 3 + 5 * k : 8 + 5 * k]).angles_rad[0] for k in which]
        )
        H, v = numeric(h, self.x), wrap_angle(np.ravel(angles) - h(self.x))
        noise = np.kron(np.eye(len(which)), R)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + noise)
        self.x, self.P = self.x + K @ v, (np.eye(len(self.x)) - K @ H) @ self.P


def test_it_is_that_of_the_equations():
    truth, rng = circle(25), np.random.default_rng(3)
    Q, R, start = np.diag([0.02, 0.01, 0.01]) ** 2, np.diag([0.01, 0.02]) ** 2, np.diag([1e-3, 2e-3, 1e-3])
    found = LandmarkEkf(gate_probability=1, nearest_m=1.0).begin(truth[0], start)
    naive = Naive(truth[0], start, 0.5)
    for i in range(len(truth)):
        if i:
            motion = between(truth, np.array([[i - 1, i]]))[0]
            found.predict(motion, Q)
            naive.predict(motion, Q)
        if i % 5 == 0 and i // 5 < len(POINTS):
            angles = direction(truth[i], POINTS[i // 5]) + 0.01 * rng.standard_normal(2)
            found.observe(np.array([found.add_view()]), angles[None], R[None])
            naive.take(angles, R)
        elif i:
            which = np.arange(1 + min(i // 5, 5))
            angles = np.array([direction(truth[i], POINTS[k]) for k in which]) + 0.01 * rng.standard_normal(
                (len(which), 2)
            )
            found.observe(which, angles, np.tile(R, (len(which), 1, 1)))
            naive.observe(which, angles, R)
    at, covariance = found.pose()
    assert wrap_angle(at - naive.x[:3]) == pytest.approx(0, abs=1e-6)
    assert np.allclose(covariance, naive.P[:3, :3], atol=1e-8)
    expected, J = positions(naive.x[3:].reshape(-1, 5))
    assert np.allclose(found.views(), expected, atol=1e-5)
    assert np.allclose(found.view_covariances()[2], J[2] @ naive.P[13:18, 13:18] @ J[2].T, atol=1e-6)
    assert found.variables == 3 + 5 * 6


def noisy_drive(seed, steps=60, sigma=0.005):
    """Errors (3,) of the last pose and their covariance, of a drive with noise that is as it is said to be."""
    rng, truth = np.random.default_rng(seed), circle(steps)
    Q, R = np.diag([0.01, 0.01, 0.005]) ** 2, np.tile(sigma**2 * np.eye(2), (len(POINTS), 1, 1))
    found = LandmarkEkf().begin(truth[0], 1e-6 * np.eye(3))
    for _ in POINTS:
        found.add_view()
    for i in range(len(truth)):
        if i:
            motion = between(truth, np.array([[i - 1, i]]))[0] + rng.standard_normal(3) @ np.sqrt(Q)
            found.predict(motion, Q)
        seen = np.array([direction(truth[i], point) for point in POINTS])
        found.observe(np.arange(len(POINTS)), seen + sigma * rng.standard_normal(seen.shape), R)
    off = found.pose()[0] - truth[-1]
    off[2] = wrap_angle(off[2])
    return off, found.pose()[1]


def test_errors_are_as_large_as_the_covariance_says():
    """The mean of 20 NEES of three degrees of freedom lies within the 99.9 % bounds of chi2 with 60, over 20."""
    squares = [off @ np.linalg.solve(P, off) for off, P in map(noisy_drive, range(20))]
    assert 1.4 < np.mean(squares) < 5.0


def test_what_is_no_direction_costs_that_observation_alone():
    found = LandmarkEkf().begin(np.zeros(3), 1e-6 * np.eye(3))
    for _ in range(3):
        found.add_view()
    angles = np.array([[0.0, 0.1], [np.nan, 0.1], [1.0, 0.2]])
    R = np.tile(1e-4 * np.eye(2), (3, 1, 1))
    R[2] = -R[2]
    believed, warnings = found.observe(np.arange(3), angles, R)
    assert believed.tolist() == [True, False, False]
    assert [warning.split("landmark ")[1][0] for warning in warnings] == ["1", "2"]
    assert np.isfinite(found.views()).all()
    assert np.linalg.eigvalsh(found.view_covariances()[1])[0] > 0
