"""FastSLAM on maps of views: conformance, the likelihoods and proposals in full, seeds, resampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from omnilab.geometry import wrap_angle
from omnilab.testing import check_view_filter
from omnilab_slam import FastSlam, FastSlam2, ViewEkf
from omnilab_slam.view_model import predict_angles

FILTERS = pytest.mark.parametrize("kind", [FastSlam, FastSlam2])
R = np.diag([0.05, 0.08]) ** 2
VIEW, SPREAD = np.array([3.0, 1.0, 0.4]), np.diag([0.3, 0.2, 0.1]) ** 2


@pytest.mark.parametrize(("view_filter", "near_m"), [(FastSlam(particles=2000), 0.1), (FastSlam2(particles=500), 0.1)])
def test_keeps_the_contract(view_filter, near_m):
    check_view_filter(view_filter, near_m)


def observed(kind, particles=4, seed=1):
    """A map after one motion and one observation of a known view; and as it was before the observation."""
    found = kind(particles=particles, seed=seed, gate_probability=1).begin(np.zeros(3), 1e-12 * np.eye(3))
    found.know_view(VIEW, SPREAD)
    found.predict(np.array([0.5, 0.1, 0.2]), np.diag([0.1, 0.1, 0.05]) ** 2)
    poses, spread = found._poses.copy(), found._spread.copy()
    angles = predict_angles(np.array([0.55, 0.05, 0.25]), VIEW[None]).angles_rad
    found.observe(np.array([0]), angles, R[None])
    return found, poses, spread, angles[0]


def test_weights_are_likelihoods_and_views_are_kalman_filters_of_their_own():
    found, poses, _, angles = observed(FastSlam)
    weights = []
    for i, robot in enumerate(poses):
        at = predict_angles(robot, VIEW[None])
        H, v = at.J_view[0], wrap_angle(angles - at.angles_rad[0])
        S = H @ SPREAD @ H.T + R
        weights.append(multivariate_normal.pdf(v, cov=S))
        K = SPREAD @ H.T @ np.linalg.inv(S)
        assert found._views[i, 0] == pytest.approx(VIEW + K @ v)
        assert np.allclose(found._covariances[i, 0], (np.eye(3) - K @ H) @ SPREAD)
    assert found._weights == pytest.approx(np.array(weights) / np.sum(weights))
    mean, covariance = found.pose()
    off = poses - mean
    assert mean == pytest.approx(found._weights @ poses)
    assert np.allclose(covariance, (found._weights[:, None] * off).T @ off, atol=1e-9)


def test_fast_slam2_draws_from_what_odometry_and_observation_say_together():
    found, poses, spread, angles = observed(FastSlam2, particles=20_000)
    at = predict_angles(poses[0], VIEW[None])
    H, S = at.J_robot[0], at.J_view[0] @ SPREAD @ at.J_view[0].T + R
    K = spread[0] @ H.T @ np.linalg.inv(H @ spread[0] @ H.T + S)
    expected = poses[0] + K @ wrap_angle(angles - at.angles_rad[0])
    assert found._poses.mean(axis=0) == pytest.approx(expected, abs=4e-3)
    assert np.allclose(np.cov(found._poses.T), (np.eye(3) - K @ H) @ spread[0], atol=3e-4)


@FILTERS
def test_a_seed_gives_the_same_map_and_another_seed_another(kind):
    first, again, other = (observed(kind, 50, seed)[0].pose()[0] for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


@FILTERS
def test_particles_that_explain_nothing_die_and_take_their_past_with_them(kind):
    """Odometry errs much in y; one look at a view ahead of it tells, and the whole trajectory follows."""
    found = kind(particles=3000).begin(np.zeros(3), 1e-12 * np.eye(3))
    found.know_view(np.array([10.0, 0, 0]), 1e-12 * np.eye(3))
    for _ in range(3):
        found.predict(np.array([1.0, 0, 0]), np.diag([0.01, 0.5, 0.001]) ** 2)
    seen = predict_angles(np.array([3.0, 1.5, 0]), np.array([[10.0, 0, 0]])).angles_rad
    believed, _ = found.observe(np.array([0]), seen, 1e-4 * np.eye(2)[None])
    assert believed.all()
    assert found.pose()[0][1] == pytest.approx(1.5, abs=0.1)
    assert found.finish()[:, 1] == pytest.approx([0, 0.5, 1.0, 1.5], abs=0.12)  # Brownian: a straight line in the mean


def test_many_particles_agree_with_the_kalman_filter_where_all_is_nearly_linear():
    maps = [one.begin(np.zeros(3), 1e-4 * np.eye(3)) for one in (ViewEkf(), FastSlam(particles=20_000))]
    for one in maps:
        one.know_view(np.array([4.0, 2, 0]), 1e-4 * np.eye(3))
        one.predict(np.array([0.5, 0, 0]), np.diag([0.03, 0.03, 0.02]) ** 2)
        one.observe(
            np.array([0]), predict_angles(np.array([0.52, 0.02, 0.01]), np.array([[4.0, 2, 0]])).angles_rad, R[None]
        )
    (mean, covariance), (sampled, spread) = (one.pose() for one in maps)
    assert sampled == pytest.approx(mean, abs=1.5e-3)
    assert np.allclose(spread, covariance, rtol=0.1, atol=5e-5)
