"""A step of the view filters against the number of views; one that sees ten of them."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from omnilab_slam import ViewEkf, ViewGraph
from omnilab_slam.view_model import predict_angles

MOTION, Q, R = np.array([1.0, 0, 0.06]), np.diag([1e-3, 1e-3, 1e-4]), 0.01 * np.eye(2)


@pytest.fixture(autouse=True)
def _one_thread():
    """These matrices are too small for several."""
    with threadpool_limits(1):
        yield


def mapped(view_filter, count, seen=10):
    """A map of so many views, and those (ten) that are nearest but not too near."""
    found = view_filter.begin(np.zeros(3), 1e-6 * np.eye(3))
    for _ in range(count):
        found.predict(MOTION, Q)
        found.add_view()
    found.predict(MOTION, Q)
    pose, views = found.pose()[0], found.views()
    predicted = predict_angles(pose, views)
    near = np.argsort(np.where(predicted.distance_m > 0.9, predicted.distance_m, np.inf))[:seen]
    return found, near, predicted.angles_rad[near]


@pytest.mark.benchmark(group="views: ten of N seen, EKF")
@pytest.mark.parametrize("count", [12, 25, 50, 100, 200, 400])
def test_view_ekf(benchmark, count):
    found, near, angles = mapped(ViewEkf(), count)
    covariances = np.tile(R, (len(near), 1, 1))
    benchmark.extra_info.update(what="`view_ekf`", size=count, of="views", unit="an update")
    believed, warnings = benchmark.pedantic(found.observe, (near, angles, covariances), rounds=50, warmup_rounds=5)
    assert believed.all()
    assert not warnings


@pytest.mark.benchmark(group="views: ten of N seen, EKF")
@pytest.mark.parametrize("count", [12, 25, 50, 100, 200, 400])
def test_dense_equations(benchmark, count):
    """The update as it is printed, of matrices in full."""
    rng, n, k = np.random.default_rng(0), 3 + 3 * count, 20
    A, H = rng.standard_normal((n, n)), np.zeros((k, n))
    P, x, v = A @ A.T / n, np.zeros(n), rng.standard_normal(k)
    H[:, :33] = rng.standard_normal((k, 33))

    def update():
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.01 * np.eye(k))
        return x + K @ v, (np.eye(n) - K @ H) @ P

    benchmark.extra_info.update(peer="the equations as printed, in numpy", size=count, of="views")
    benchmark.pedantic(update, rounds=5)


@pytest.mark.benchmark(group="views: ten or fifty of N seen, graph")
@pytest.mark.parametrize(("count", "seen"), [(25, 10), (100, 10), (100, 50)])
def test_view_graph(benchmark, count, seen):
    found, near, angles = mapped(ViewGraph(), count, seen)
    covariances = np.tile(R, (len(near), 1, 1))
    why = "it stands on GTSAM, whose own solvers are beside the back ends; no library has this filter"
    benchmark.extra_info.update(what=f"{seen} in sight", size=count, of="views", unit="an update", no_peer=why)
    believed, warnings = benchmark.pedantic(found.observe, (near, angles, covariances), rounds=10, warmup_rounds=1)
    assert believed.all()
    assert not warnings
