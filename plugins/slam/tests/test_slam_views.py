"""The view filters: conformance, the equations in full, derivatives, gating, an update that fails."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import between
from omnilab.testing import check_view_filter
from omnilab_slam import ViewEkf, ViewGraph
from omnilab_slam.view_factor import angles_in_own_frames
from omnilab_slam.view_model import mahalanobis, planar_rotation, predict_angles

Q = np.diag([0.02, 0.01, 0.01]) ** 2
R = np.array([[0.01, 0.003], [0.003, 0.02]])
FILTERS = pytest.mark.parametrize("view_filter", [ViewEkf(), ViewGraph()], ids=["ekf", "graph"])


@FILTERS
def test_keeps_the_contract(view_filter):
    check_view_filter(view_filter)


# ---------------------------------------------------------------------------------------------- the equations in full
def angles_of(robot, view):
    return np.array([np.arctan2(view[1] - robot[1], view[0] - robot[0]) - robot[2], view[2] - robot[2]])


def numeric(function, at, h=1e-6):
    columns = [(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))]
    return np.column_stack(columns)


class Naive:
    """Gil et al. (2012), eq. 1 to 12: whole matrices, numeric derivatives, no blocks."""

    def __init__(self, pose, covariance):
        self.x, self.P = np.array(pose, float), np.array(covariance, float)

    def predict(self, motion, covariance):
        def moved(x):
            c, s = np.cos(x[2]), np.sin(x[2])
            step = np.array([c * motion[0] - s * motion[1], s * motion[0] + c * motion[1], motion[2]])
            return np.concatenate([x[:3] + step, x[3:]])

        F = numeric(moved, self.x)
        noise = np.zeros_like(self.P)
        G = np.array([[np.cos(self.x[2]), -np.sin(self.x[2]), 0], [np.sin(self.x[2]), np.cos(self.x[2]), 0], [0, 0, 1]])
        noise[:3, :3] = G @ covariance @ G.T
        self.x, self.P = moved(self.x), F @ self.P @ F.T + noise

    def observe(self, views, angles, covariances):
        def h(x):
            return np.concatenate([angles_of(x[:3], x[3 + 3 * i : 6 + 3 * i]) for i in views])

        H, noise = numeric(h, self.x), np.zeros((2 * len(views), 2 * len(views)))
        for k, one in enumerate(covariances):
            noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = one
        v = np.mod(np.ravel(angles) - h(self.x) + np.pi, 2 * np.pi) - np.pi
        S = H @ self.P @ H.T + noise
        K = self.P @ H.T @ np.linalg.inv(S)
        joseph = np.eye(len(self.x)) - K @ H
        self.x, self.P = self.x + K @ v, joseph @ self.P @ joseph.T + K @ noise @ K.T

    def add_view(self):
        J = np.vstack([np.eye(len(self.x)), np.eye(3, len(self.x))])
        self.x, self.P = J @ self.x, J @ self.P @ J.T

    def know_view(self, pose, covariance):
        self.x, self.P = np.append(self.x, pose), block_diag(self.P, covariance)


def drive(found, steps, rng, views_every=6, nearest=1.0, noise=0.05, extra=(), known=()):
    """A noisy drive round a circle; every map in `extra` gets the same. Views at the poses `known` are from before."""
    angle = 2 * np.pi * np.arange(steps + 1) / 40
    truth = np.column_stack([4 * np.cos(angle), 4 * np.sin(angle), wrap_angle(angle + np.pi / 2)])
    motions = between(truth, np.column_stack([np.arange(steps), np.arange(1, steps + 1)]))
    motions += rng.standard_normal(motions.shape) @ np.sqrt(Q)
    kept = list(known)
    for i in range(1, steps + 1):
        for one in (found, *extra):
            one.predict(motions[i - 1], Q)
        seen = [k for k, view in enumerate(kept) if np.hypot(*(view - truth[i])[:2]) > nearest]
        if seen:
            angles = np.array([angles_of(truth[i], kept[k]) for k in seen])
            angles = angles + noise * rng.standard_normal(angles.shape)
            for one in (found, *extra):
                one.observe(np.array(seen), angles, np.tile(R, (len(seen), 1, 1)))
        if i % views_every == 0:
            kept.append(truth[i])
            for one in (found, *extra):
                one.add_view()
    return truth, np.array(kept)


def test_ekf_is_that_of_the_equations():
    start = np.diag([1e-3, 2e-3, 1e-3])
    angle0 = np.array([4.0, 0, np.pi / 2])
    found, naive = ViewEkf(gate_probability=1).begin(angle0, start), Naive(angle0, start)
    drive(found, 130, np.random.default_rng(0), extra=(naive,))  # 21 views: more than there is room for at first
    pose, spread = found.pose()
    views, spreads = found.views(), found.view_covariances()
    assert len(views) == 21
    assert np.allclose(wrap_angle(pose - naive.x[:3])[2], 0, atol=1e-6)
    assert np.allclose(pose[:2], naive.x[:2], atol=1e-6)
    assert np.allclose(spread, naive.P[:3, :3], atol=1e-8)
    expected = naive.x[3:].reshape(-1, 3)
    assert np.allclose(views[:, :2], expected[:, :2], atol=1e-6)
    assert np.allclose(wrap_angle(views[:, 2] - expected[:, 2]), 0, atol=1e-6)
    for i, one in enumerate(spreads):
        assert np.allclose(one, naive.P[3 + 3 * i : 6 + 3 * i, 3 + 3 * i : 6 + 3 * i], atol=1e-8)


KNOWN = np.array([[5.5, 1.0, 2.0], [-1.0, 5.0, -3.0], [-5.0, -3.0, 0.5]])


def knowing(view_filters, spread, rng):
    """Maps with views from before, at poses that are not quite the true ones."""
    given = KNOWN + rng.standard_normal(KNOWN.shape) @ np.linalg.cholesky(spread).T
    for one in view_filters:
        for pose in given:
            one.know_view(pose, spread)


def test_ekf_with_views_from_before_is_that_of_the_equations():
    start, angle0, spread = np.diag([1e-3, 2e-3, 1e-3]), np.array([4.0, 0, np.pi / 2]), np.diag([0.04, 0.01, 0.001])
    found, naive = ViewEkf(gate_probability=1).begin(angle0, start), Naive(angle0, start)
    knowing((found, naive), spread, np.random.default_rng(7))
    drive(found, 130, np.random.default_rng(0), extra=(naive,), known=KNOWN)
    pose, P = found.pose()
    assert np.allclose(pose[:2], naive.x[:2], atol=1e-6)
    assert np.allclose(P, naive.P[:3, :3], atol=1e-8)
    assert np.allclose(found.views()[:3, :2], naive.x[3:12].reshape(3, 3)[:, :2], atol=1e-6)
    assert np.allclose(found.view_covariances()[1], naive.P[6:9, 6:9], atol=1e-8)


@pytest.mark.slow
@FILTERS
def test_views_from_before_keep_a_robot_where_it_is_and_become_surer(view_filter):
    """Its start is off by a metre, and it takes no views itself: errors are as the covariances say."""
    squares, rng, spread = [], np.random.default_rng(8), np.diag([0.02, 0.02, 0.01]) ** 2
    start, off = np.array([4.0, 0, np.pi / 2]), np.diag([0.5, 0.5, 0.2])
    for _ in range(20):
        found = view_filter.begin(start + off @ rng.standard_normal(3), off**2)
        knowing((found,), spread, rng)
        truth, _ = drive(found, 40, rng, views_every=999, known=KNOWN)
        pose, P = found.pose()
        error = pose - truth[-1]
        error[2] = wrap_angle(error[2])
        squares.append(error @ np.linalg.solve(P, error))
        assert np.trace(P[:2, :2]) < 0.1 * np.trace(off[:2, :2] ** 2)
        assert np.all(np.trace(found.view_covariances(), axis1=1, axis2=2) < np.trace(spread))
        assert found.finish().shape == truth.shape
    assert 1.5 < np.mean(squares) < 6  # 3 is expected


def test_both_filters_agree_where_all_is_nearly_linear():
    rng, start = np.random.default_rng(1), 1e-6 * np.eye(3)
    ekf, graph = (f.begin(np.array([4.0, 0, np.pi / 2]), start) for f in (ViewEkf(), ViewGraph()))
    truth, _ = drive(ekf, 60, rng, noise=0.01, extra=(graph,))
    (pose, spread), (other, its_spread) = ekf.pose(), graph.pose()
    assert np.allclose(pose, other, atol=0.02)
    assert np.allclose(spread, its_spread, atol=0.05 * spread.max())
    assert np.allclose(ekf.views(), graph.views(), atol=0.03)
    sigma = [np.sqrt(np.diagonal(each.pose()[1])) for each in (ekf, graph)]
    assert np.allclose(sigma[0], sigma[1], rtol=0.2)
    assert np.abs(graph.finish()[:, :2] - truth[:, :2]).max() < 0.2


def test_a_new_view_moves_with_the_robot():
    """Fully correlated: what corrects an old view corrects one that was taken this moment as much."""
    found = ViewEkf().begin(np.zeros(3), 1e-6 * np.eye(3))
    found.add_view()
    for _ in range(5):
        found.predict(np.array([1.0, 0, 0]), np.diag([0.1, 0.1, 0.02]) ** 2)
    found.add_view()
    found.observe(np.array([0]), np.array([[np.pi - 0.03, 0.02]]), 1e-3 * np.eye(2)[None])
    pose, spread = found.pose()
    views, spreads = found.views(), found.view_covariances()
    assert np.allclose(pose, views[1])
    assert np.allclose(spread, spreads[1])


# -------------------------------------------------------------------------------------------------------- derivatives
numbers = st.floats(-3, 3)


@given(st.lists(numbers, min_size=3, max_size=3), st.lists(numbers, min_size=3, max_size=3))
def test_derivatives_are_the_numeric_ones(robot, view):
    robot, view = np.array(robot), np.array(view)
    if np.hypot(*(view - robot)[:2]) < 0.2 or abs(np.arctan2(*(view - robot)[1::-1])) > 3.14:
        return  # the angle jumps there
    predicted = predict_angles(robot, view[None])
    assert np.allclose(predicted.angles_rad[0], angles_of(robot, view))
    assert np.allclose(predicted.J_robot[0], numeric(lambda x: angles_of(x, view), robot), atol=1e-6)
    assert np.allclose(predicted.J_view[0], numeric(lambda x: angles_of(robot, x), view), atol=1e-6)


def test_the_factor_s_derivatives_are_by_moves_in_each_pose_s_own_frame():
    import gtsam

    rng = np.random.default_rng(2)
    for nearest_m in [1.0] * 20 + [9.0] * 20:  # views that are far enough, and views that are too near
        a, b = gtsam.Pose2(*rng.uniform(-2, 2, 3)), gtsam.Pose2(*rng.uniform(3, 5, 3))

        def rows(a, b, nearest_m=nearest_m):
            return angles_in_own_frames(a.x(), a.y(), a.theta(), b.x(), b.y(), b.theta(), nearest_m)

        (_, _, short), by_a, by_b = rows(a, b)
        assert short == pytest.approx(max(0, nearest_m - np.hypot(b.x() - a.x(), b.y() - a.y())))
        for found, moved in (
            (by_a, lambda d, a=a, b=b: (a.retract(d), b)),
            (by_b, lambda d, a=a, b=b: (a, b.retract(d))),
        ):
            expected = numeric(lambda d, moved=moved: np.array(rows(*moved(d))[0]), np.zeros(3))
            assert np.allclose(found, expected, atol=1e-6)


def test_a_pose_is_not_drawn_to_the_view_it_observes():
    """Two bearings that disagree are best explained from the view itself, were it not known to be farther off."""
    nearest, sigma = {}, {}
    for nearest_m in (1.0, 1e-3):
        found = ViewGraph(gate_probability=1, nearest_m=nearest_m).begin(np.zeros(3), 1e-6 * np.eye(3))
        found.add_view()
        found.predict(np.array([1.6, 0, 0]), np.diag([0.5, 0.5, 0.01]) ** 2)
        found.observe(np.array([0]), np.array([[np.pi - 1.3, 0.0]]), R[None])
        found.predict(np.array([0.0, 0.5, 0]), np.diag([1e-3, 1e-3, 1e-3]) ** 2)
        found.observe(np.array([0]), np.array([[-np.pi + 1.3, 0.0]]), R[None])
        nearest[nearest_m] = np.hypot(*found.finish()[1:, :2].T).min()
        sigma[nearest_m] = np.sqrt(np.diagonal(found.pose()[1])[:2]).min()
    assert nearest[1.0] > 1.5 * nearest[1e-3]
    assert sigma[1.0] > 1.5 * sigma[1e-3]


def test_what_the_graph_predicts_is_its_marginals_propagated():
    """Against the dense covariance of the robot with each view, from GTSAM's batch marginals."""
    import gtsam

    found = ViewGraph().begin(np.array([4.0, 0, np.pi / 2]), 1e-4 * np.eye(3))
    drive(found, 40, np.random.default_rng(3), noise=0.01)
    nodes = found._views[1:4][::-1]
    robot, views = found._pose(found._step), np.array([found._pose(node) for node in nodes])
    S = found._predicted_covariances(nodes, predict_angles(robot, views))
    marginals = gtsam.Marginals(found._factors, found._tree.calculateEstimate())
    for k, node in enumerate(nodes):
        joint = marginals.jointMarginalCovariance([found._step, node])
        both = [(i, j) for i in (found._step, node) for j in (found._step, node)]
        P = np.block([[joint.at(*both[0]), joint.at(*both[1])], [joint.at(*both[2]), joint.at(*both[3])]])
        _, A, B = angles_in_own_frames(*robot, *views[k], 0.2)
        H = np.hstack([A[:2], B[:2]])
        assert np.allclose(S[k], H @ P @ H.T, rtol=2e-2, atol=1e-6)


def test_mahalanobis_is_that_of_an_inverse():
    rng = np.random.default_rng(4)
    roots = rng.standard_normal((7, 2, 2))
    S, v = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2), rng.standard_normal((7, 2))
    assert np.allclose(mahalanobis(v, S), np.einsum("ki,kij,kj->k", v, np.linalg.inv(S), v))
    assert np.isinf(mahalanobis(v[:1], -S[:1]))[0]


def test_a_planar_rotation_leaves_headings():
    assert np.allclose(planar_rotation(np.pi / 2) @ [1, 0, 5], [0, 1, 5])


# ------------------------------------------------------------------------------------------------------------- gating
def test_the_gate_is_a_quantile_of_chi2():
    from scipy.stats import chi2

    assert ViewEkf(gate_probability=0.9).gate == pytest.approx(chi2.ppf(0.9, 2))
    assert ViewEkf(gate_probability=1).gate == np.inf


@FILTERS
def test_wrong_associations_are_gated_and_cost_nothing(view_filter):
    found = view_filter.begin(np.array([4.0, 0, np.pi / 2]), 1e-6 * np.eye(3))
    drive(found, 60, np.random.default_rng(5), noise=0.05)
    pose, spread = found.pose()
    views = found.views()
    angles = np.array(
        [angles_of(pose, views[2]) + np.array([1.2, 0]), angles_of(pose, views[5]), angles_of(pose, views[3]) - [0, 1]]
    )
    believed, warnings = found.observe(np.array([2, 5, 3]), angles, np.tile(1e-2 * np.eye(2), (3, 1, 1)))
    assert believed.tolist() == [False, True, False]
    assert not warnings
    assert np.allclose(found.pose()[0], pose, atol=0.02)
    assert np.trace(found.pose()[1]) < np.trace(spread)


@FILTERS
def test_angles_may_be_given_in_any_turn(view_filter):
    found = view_filter.begin(np.array([4.0, 0, np.pi / 2]), 1e-6 * np.eye(3))
    drive(found, 30, np.random.default_rng(6))
    pose, views = found.pose()[0], found.views()
    angles = angles_of(pose, views[1]) + 2 * np.pi * np.array([1, -2])
    believed, _ = found.observe(np.array([1]), angles[None], R[None])
    assert believed.all()
    assert np.allclose(found.pose()[0], pose, atol=1e-3)


# ------------------------------------------------------------------------------------------------- an update that fails
def test_an_update_of_the_graph_that_fails_becomes_a_warning_and_the_map_goes_on(monkeypatch):
    found = ViewGraph().begin(np.array([4.0, 0, np.pi / 2]), 1e-6 * np.eye(3))
    drive(found, 20, np.random.default_rng(7))
    usual, calls = found._update, []

    def fail_once(factors, poses):
        calls.append(1)
        if len(calls) == 1:
            raise RuntimeError("Indeterminant linear system")
        usual(factors, poses)

    before = found.pose()[0]
    monkeypatch.setattr(found, "_update", fail_once)
    warnings = found.predict(np.array([0.5, 0, 0]), Q)
    assert "step 21: the motion could not be added" in warnings[0]
    assert np.allclose(np.hypot(*(found.pose()[0] - before)[:2]), 0.5, atol=0.05)
    calls.clear()
    angles = angles_of(found.pose()[0], found.views()[0])
    believed, warnings = found.observe(np.array([0]), angles[None], R[None])
    assert not believed.any()
    assert "step 21: the observations could not be added" in warnings[0]
    assert found.observe(np.array([0]), angles[None], R[None])[0].all()
    assert found.finish().shape == (22, 3)
