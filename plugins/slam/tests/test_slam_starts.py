"""Initial guesses: the chordal one against dense linear algebra and known truth, the best of several against known optima."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from omnilab.api import PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import between, chi2, dead_reckoning, matrices, residuals, vectors
from omnilab_slam import GtsamBatch, GtsamGnc, GtsamIsam2, starts
from omnilab_slam.kernels import Kernel
from omnilab_slam.least_squares.chordal import chordal
from omnilab_slam.least_squares.descent import Descent
from omnilab_slam.least_squares.gauss_newton import gauss_newton
from omnilab_slam.starts import Start, initial_poses


def two_laps(planar, seed=0, count=40, sigma_rad=0.3):
    """Two laps of a circle, a loop closure to the lap before every fourth pose; and the true poses.

    With these seeds odometry winds once too often or too seldom, and the optimum near it is a local one.
    """
    rng, angle, sigma_m = np.random.default_rng(seed), np.linspace(0, 4 * np.pi, count), 0.05
    half = count // 2
    edges = np.array([*((i, i + 1) for i in range(count - 1)), *((i, i + half) for i in range(0, half, 4))])
    tilt = np.zeros(count) if planar else 0.5 * np.sin(3 * angle)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.from_euler("zy", np.column_stack([angle + planar * np.pi / 2, tilt])).as_matrix()
    T[:, :3, 3] = np.column_stack(
        [10 * np.cos(angle), 10 * np.sin(angle), 0 * angle if planar else 3 * np.sin(2 * angle)]
    )
    truth, d = vectors(T, planar), 3 if planar else 6
    turns, size = 1 if planar else 3, 2 if planar else 3
    noise = rng.standard_normal((len(edges), size + turns)) * ([sigma_m] * size + [sigma_rad] * turns)
    if planar:
        motions = between(truth, edges) + noise
    else:
        M = matrices(between(truth, edges))
        M[:, :3, 3] += noise[:, :3]
        M[:, :3, :3] @= Rotation.from_rotvec(noise[:, 3:]).as_matrix()
        motions = vectors(M, planar=False)
    weight = np.diag([sigma_m**-2.0] * size + [sigma_rad**-2.0] * turns)
    assert weight.shape == (d, d)
    graph = PoseGraph(np.arange(count), truth, edges, motions, np.tile(weight, (len(edges), 1, 1)))
    return replace(graph, poses=dead_reckoning(graph)), truth


def optimum_by_scipy(graph, near):
    """chi2 where scipy's trust region ends from poses (N, k): another solver, another parametrisation."""
    L = np.swapaxes(np.linalg.cholesky(graph.information), 1, 2)
    T, d = matrices(near), graph.information.shape[1]

    def moved(x):
        step, out = np.zeros((len(T), 6)), T.copy()
        step[1:, [0, 1, 5] if d == 3 else slice(None)] = x.reshape(-1, d)
        out[:, :3, 3] += step[:, :3]
        out[:, :3, :3] = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ out[:, :3, :3]
        return vectors(out, graph.planar)

    def errors(x):
        return (L @ residuals(graph, moved(x))[:, :, None]).ravel()

    return 2 * least_squares(errors, np.zeros(d * (len(T) - 1)), method="lm", ftol=1e-6, xtol=1e-6).cost


def random_graph(planar, seed):
    """A connected graph of exact motions with random information, its nodes in no order and its poses forgotten."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 12))
    tree = [(i, int(rng.integers(i))) for i in range(1, count)]
    extra = [tuple(rng.choice(count, 2, replace=False).tolist()) for _ in range(int(rng.integers(6)))]
    edges = np.array([pair[:: rng.choice([-1, 1])] for pair in tree + extra])
    size, d = (2, 3) if planar else (3, 6)
    heading = rng.uniform(-3, 3, (count, 1)) if planar else Rotation.random(count, rng=rng).as_quat()
    truth = np.column_stack([rng.uniform(-9, 9, (count, size)), heading])
    spread = rng.standard_normal((len(edges), d, d))
    W = spread @ spread.transpose(0, 2, 1) + 0.1 * np.eye(d)
    forgotten = np.tile(truth[0], (count, 1))
    return PoseGraph(np.arange(count), forgotten, edges, between(truth, edges), W), truth


@pytest.mark.parametrize("planar", [True, False])
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_chordal_meets_exact_motions_from_nothing(planar, seed):
    graph, truth = random_graph(planar, seed)
    found = chordal(graph)
    assert np.allclose(matrices(found), matrices(truth), atol=1e-6)
    assert np.array_equal(found[0], graph.poses[0])


def test_chordal_in_the_plane_is_complex_least_squares():
    """Of unit numbers r: |r_j - r_i exp(i z)|, then of positions with all headings known; by dense algebra."""
    graph, _ = two_laps(planar=True, seed=3)
    i, j = graph.edges.T
    z, rows = graph.motions, np.arange(len(graph.edges))
    A, B = (np.zeros((len(rows), len(graph)), complex) for _ in range(2))
    A[rows, j] = 1
    B[rows, i] = np.exp(1j * z[:, 2])
    M = (A - B) * np.sqrt(graph.information[:, 2, 2])[:, None]
    r = np.linalg.lstsq(M[:, 1:], -M[:, 0] * np.exp(1j * graph.poses[0, 2]), rcond=None)[0]
    heading = np.angle(np.append(np.exp(1j * graph.poses[0, 2]), r))
    D = np.zeros((len(rows), len(graph)))
    D[rows, j], D[rows, i] = 1, -1
    step = np.exp(1j * heading[i]) * (z[:, 0] + 1j * z[:, 1])
    start = graph.poses[0, 0] + 1j * graph.poses[0, 1]
    p = np.append(start, np.linalg.lstsq(D[:, 1:].astype(complex), step - D[:, 0] * start, rcond=None)[0])
    T, expected = matrices(chordal(graph)), matrices(np.column_stack([p.real, p.imag, heading]))
    assert np.allclose(T, expected, atol=1e-9)


@pytest.mark.parametrize("planar", [True, False])
def test_the_best_start_leaves_the_local_minimum_of_odometry(planar):
    graph, truth = two_laps(planar)
    stuck, found = GtsamBatch(start=Start.given).optimize(graph), GtsamBatch().optimize(graph)
    optimum = optimum_by_scipy(graph, truth if planar else found.poses)  # from the truth in space: half a minute
    assert optimum == pytest.approx(GtsamBatch(start=Start.given).optimize(replace(graph, poses=truth)).chi2, rel=1e-4)
    assert stuck.chi2 > 2 * optimum
    assert found.chi2 == pytest.approx(optimum, rel=1e-4)
    assert GtsamBatch(start=Start.chordal).optimize(graph).chi2 == pytest.approx(optimum, rel=1e-4)
    assert list(found.starts) == ["chordal", "given"]
    assert found.starts["chordal"] == pytest.approx(found.chi2)
    assert found.starts["given"] == pytest.approx(stuck.chi2)
    assert found.chi2_before == chi2(graph)
    assert "start=given ends in a local minimum" in found.notes[0]
    assert not found.warnings


@pytest.mark.parametrize("planar", [True, False])
def test_no_two_starts_of_the_same_optimum_change_a_bit(planar):
    graph, _ = two_laps(planar, seed=2)
    given, best = GtsamBatch(start=Start.given).optimize(graph), GtsamBatch().optimize(graph)
    assert np.array_equal(given.poses, best.poses)
    assert (given.chi2, given.iterations, given.chi2_before) == (best.chi2, best.iterations, best.chi2_before)
    assert best.starts == {"given": best.chi2, "chordal": best.chi2}
    assert not best.notes


def test_a_step_that_leads_up_ends_a_descent_without_damping():
    graph, _ = two_laps(planar=True)
    stuck = gauss_newton(graph, graph.poses, np.ones_like, 20, 1e-9, max_damping=0)
    assert not stuck.converged
    assert stuck.edge_chi2.sum() <= chi2(graph)
    assert Descent(graph, 100).optimum(graph.poses) is None
    easy, truth = two_laps(planar=True, sigma_rad=0.05)
    assert Descent(easy, 100).optimum(easy.poses).chi2 == pytest.approx(optimum_by_scipy(easy, truth), rel=1e-9)
    assert Descent(easy, 1).optimum(easy.poses) is None  # too few steps


def test_of_many_poses_a_hopeless_start_is_not_followed_where_noise_explains_the_other(monkeypatch):
    graph, _ = two_laps(planar=True)
    both = GtsamBatch().optimize(graph)
    monkeypatch.setattr(starts, "ALL_FOLLOWED", 0)
    found = GtsamBatch().optimize(graph)
    assert np.array_equal(found.poses, both.poses)
    assert (found.chi2, found.chi2_before) == (both.chi2, both.chi2_before)
    assert list(both.starts) == ["chordal", "given"]
    assert found.starts == {"chordal": both.chi2}
    assert "backend.start=given follows the other" in found.notes[0]
    surer = replace(graph, information=100 * graph.information)  # noise explains a hundredth
    assert list(GtsamBatch().optimize(surer).starts) == ["chordal", "given"]


def test_a_given_start_that_is_better_is_kept_and_the_other_is_named():
    """Noise of half a radian: the chordal start is no panacea."""
    graph, truth = two_laps(planar=True, sigma_rad=0.5)
    found = GtsamBatch().optimize(replace(graph, poses=truth))
    other = GtsamBatch(start=Start.chordal).optimize(graph)
    assert found.chi2 == min(found.starts.values())
    assert set(found.starts) == {"given", "chordal"}
    assert found.starts["chordal"] == pytest.approx(other.chi2, rel=1e-3)


def test_robust_back_ends_take_the_start_of_the_lower_robust_cost():
    """Every loop closure is sound: from odometry's winding they are rejected, from the chordal start they are kept."""
    graph, truth = two_laps(planar=True)
    optimum = GtsamBatch(start=Start.given).optimize(replace(graph, poses=truth)).chi2
    for backend in (GtsamGnc(), GtsamBatch(kernel=Kernel.dcs), GtsamBatch(kernel=Kernel.huber)):
        found = backend.optimize(graph)
        assert found.chi2 == pytest.approx(optimum, rel=0.02)
        assert not found.rejected.any()
        assert found.trusted.tolist() == [True] * 39 + [False] * 5
        assert found.starts[next(iter(found.starts))] == min(found.starts.values())
        assert "0 of 5 loop closures are rejected" in found.notes[-1]
        assert "the 39 between consecutive ids of one robot are odometry and trusted" in found.notes[-1]


def test_what_robust_back_ends_reject_is_said_with_its_limit():
    graph, _ = two_laps(planar=True, seed=2, sigma_rad=0.01)
    wrong = replace(graph, motions=graph.motions + np.array([[0, 0, 0]] * 43 + [[30, 0, 1]]))
    found = GtsamGnc().optimize(wrong)
    assert np.flatnonzero(found.rejected).tolist() == [43]
    assert "1 of 5 loop closures are rejected (chi2 beyond 11.34, which 1 % of sound ones exceed)" in found.notes[-1]
    assert "kernel dcs counts them less than half" in GtsamBatch(kernel=Kernel.dcs).optimize(wrong).notes[-1]
    plain = GtsamBatch().optimize(wrong)
    assert plain.trusted.all()
    assert not any("rejected" in sentence for sentence in plain.notes)


def test_a_tree_has_one_optimum_and_one_start():
    graph, _ = two_laps(planar=True)
    tree = replace(graph, edges=graph.edges[:39], motions=graph.motions[:39], information=graph.information[:39])
    found = GtsamBatch().optimize(tree)
    assert found.starts == {}
    assert found.chi2 == pytest.approx(0, abs=1e-9)


def test_a_chordal_start_that_fails_costs_nothing_and_is_one_sentence_when_it_was_chosen(monkeypatch):
    def fail(*arguments):
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr(starts, "chordal", fail)
    graph, _ = two_laps(planar=True)
    expected = GtsamBatch(start=Start.given).optimize(graph)
    assert np.array_equal(GtsamBatch().optimize(graph).poses, expected.poses)
    with pytest.raises(DataError, match=r"chordal finds no start.*start=odometry"):
        GtsamBatch(start=Start.chordal).optimize(graph)


def test_covariances_are_those_of_the_start_that_was_kept():
    graph, _ = two_laps(planar=True)
    found = GtsamBatch().optimize(graph, covariances=True)
    same = GtsamBatch(start=Start.chordal).optimize(graph, covariances=True)
    assert np.allclose(found.covariances, same.covariances)


def test_each_start_is_a_guess_of_all_poses():
    graph, _ = two_laps(planar=True)
    assert initial_poses(graph, Start.given) is graph.poses
    assert np.array_equal(initial_poses(graph, Start.odometry), dead_reckoning(graph))
    for start in (Start.lago, Start.chordal):
        assert chi2(graph, initial_poses(graph, start)) < chi2(graph)


def test_a_local_minimum_of_poses_as_they_come_is_said_beside_the_lower_one():
    graph, _ = two_laps(planar=True, seed=2, sigma_rad=0.4)
    found, best = GtsamIsam2().optimize(graph), GtsamBatch().optimize(graph)
    assert found.chi2 > 2 * best.chi2
    assert list(found.starts) == ["odometry", "chordal"]
    assert found.starts["chordal"] == pytest.approx(best.chi2, rel=1e-4)
    assert "backend=gtsam_batch keeps that" in found.notes[-1]
    quiet = GtsamIsam2().optimize(two_laps(planar=True, seed=2)[0])
    assert (quiet.starts, list(quiet.notes)) == ({}, [])


@pytest.mark.parametrize("backend", [GtsamBatch(), GtsamGnc()], ids=["batch", "gnc"])
def test_a_walk_that_odometry_winds_up_reaches_its_optimum(backend):
    path = Path(__file__).parents[3].parent / "shared/cases/pose_graph_local_minimum/walk100.g2o"
    if not path.is_file():
        pytest.skip("walk100.g2o, the graph of a case, is not there")
    found = backend.optimize(read_graph(path))
    assert found.chi2 == pytest.approx(40.0798, rel=1e-5)
    assert list(found.starts) == ["chordal", "given"]
    assert not found.rejected.any()
