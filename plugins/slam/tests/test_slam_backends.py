"""The back ends: conformance, published graphs to their optima, outliers, bad starts, failures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import IncrementalBackend, PoseGraph
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import between, chi2, edge_chi2, is_loop, matrices, residuals, vectors
from omnilab.testing import check_backend
from omnilab_slam import GtsamBatch, GtsamGnc, GtsamIsam2
from omnilab_slam.batch import Start
from omnilab_slam.kernels import REDESCENDING, Kernel
from omnilab_slam.least_squares.equations import PoseEquations
from omnilab_slam.least_squares.gauss_newton import gauss_newton
from omnilab_slam.least_squares.linearization import linearized

DATA = Path(__file__).parents[3].parent / "shared/data/pose_graphs"


def published(name):
    if not (DATA / name).is_file():
        pytest.skip(f"{name}, a published graph, is not there")
    return read_graph(DATA / name)


def square(laps=2, side=6, noise=0.01, seed=0):
    """A robot that goes round a square, with a loop closure to each place of the lap before."""
    rng = np.random.default_rng(seed)
    count = 4 * side * laps
    T = np.tile(np.eye(4), (count, 1, 1))
    for i in range(1, count):
        T[i] = T[i - 1] @ planar_poses([[1.0, 0, 0]], np.pi / 2 if i % side == 0 else 0)[0]
    truth = vectors(T, planar=True)
    lap = 4 * side
    pairs = [(i, i + 1) for i in range(count - 1)] + [(i, i + lap) for i in range(count - lap)]
    edges = np.array(pairs)
    motions = between(truth, edges) + noise * rng.standard_normal((len(edges), 3))
    information = np.tile(np.eye(3) / noise**2, (len(edges), 1, 1))
    return PoseGraph(np.arange(count), truth, edges, motions, information), truth


def with_wrong_loops(graph, count, seed=1):
    """Loop closures between random poses, each with a random motion."""
    rng = np.random.default_rng(seed)
    pairs = np.array([rng.choice(len(graph), 2, replace=False) for _ in range(3 * count)])
    pairs = pairs[np.abs(np.diff(pairs, axis=1)[:, 0]) > 1][:count]
    motions = np.column_stack([rng.uniform(-5, 5, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
    return replace(
        graph,
        edges=np.concatenate([graph.edges, pairs]),
        motions=np.concatenate([graph.motions, motions]),
        information=np.concatenate([graph.information, np.tile(graph.information[0], (count, 1, 1))]),
    )


@pytest.mark.parametrize(
    "backend",
    [GtsamBatch(), GtsamBatch(kernel=Kernel.huber), GtsamBatch(kernel=Kernel.dcs), GtsamIsam2(), GtsamGnc()],
    ids=["batch", "huber", "dcs", "isam2", "gnc"],
)
def test_keeps_the_contract(backend):
    check_backend(backend)


def test_only_isam2_takes_poses_as_they_come():
    assert isinstance(GtsamIsam2(), IncrementalBackend)
    assert not isinstance(GtsamBatch(), IncrementalBackend)


@pytest.mark.parametrize(
    ("name", "optimum"),
    [
        ("se_sync/intel.g2o", 45.0047),
        ("se_sync/CSAIL.g2o", 40.5551),
        ("se_sync/manhattan.g2o", 3549.04),
        ("gtsam/w100.graph", 1.13783),
        ("gtsam/noisyToyGraph.txt", 0.136652),
    ],
)
@pytest.mark.parametrize("start", Start)
def test_published_graphs_reach_their_optima(name, optimum, start):
    found = GtsamBatch(start=start).optimize(published(name))
    assert found.chi2 == pytest.approx(optimum, rel=1e-5)
    assert not found.warnings


def test_a_small_graph_ends_where_its_authors_say():
    graph, expected = published("gtsam/noisyToyGraph.txt"), published("gtsam/optimizedNoisyToyGraph.txt")
    found = GtsamBatch().optimize(graph)
    assert np.allclose(matrices(found.poses), matrices(expected.poses), atol=3e-3)  # theirs is GTSAM's own error
    assert found.chi2 < chi2(graph, expected.poses) < 1.001 * found.chi2


def test_spatial_graphs_beat_gtsam_alone_and_no_neighbour_is_better():
    graph = published("se_sync/smallGrid3D.g2o")
    found = GtsamBatch().optimize(graph)
    rng = np.random.default_rng(0)
    for size in (1e-5, 1e-4):
        for _ in range(5):
            moved = found.poses + size * rng.standard_normal(found.poses.shape) * (np.arange(len(graph)) > 0)[:, None]
            moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
            assert chi2(graph, moved) > found.chi2


def test_isam2_comes_close_to_the_optimum():
    graph = published("se_sync/intel.g2o")
    assert GtsamIsam2().optimize(graph).chi2 == pytest.approx(45.0047, rel=2e-3)


def test_covariances_are_those_of_a_chain():
    """Poses in a row, without noise in heading to speak of: variances add up along it."""
    count, sigma = 5, 0.1
    edges = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    poses = np.column_stack([np.arange(count), np.zeros(count), np.zeros(count)]).astype(float)
    information = np.tile(np.diag([1 / sigma**2, 1 / sigma**2, 1e12]), (count - 1, 1, 1))
    graph = PoseGraph(np.arange(count), poses, edges, np.tile([1.0, 0, 0], (count - 1, 1)), information)
    for backend in (GtsamBatch(), GtsamIsam2(), GtsamGnc()):
        covariances = backend.optimize(graph, covariances=True).covariances
        assert covariances[1:, 0, 0] == pytest.approx(sigma**2 * np.arange(1, count), rel=1e-3)


@pytest.mark.parametrize("planar", [True, False])
def test_gradient_and_hessian_are_those_of_numeric_jacobians(planar):
    rng = np.random.default_rng(4)
    poses, motions = (rng.uniform(-1, 1, (n, 3 if planar else 7)) for n in (4, 5))
    for rows in (poses, motions):
        rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    edges = np.array([[0, 1], [2, 1], [3, 0], [1, 3], [2, 3]])
    d = 3 if planar else 6
    spread = rng.standard_normal((5, d, d))
    graph = PoseGraph(np.arange(4), poses, edges, motions, spread @ spread.transpose(0, 2, 1))
    T, h, J = matrices(poses), 1e-6, np.zeros((5, 2, d, d))
    for node in range(4):
        for axis in range(d):
            off = [_nudged(T, node, axis if axis < 2 or not planar else 5, s * h) for s in (1, -1)]
            numeric = (residuals(graph, vectors(off[0], planar)) - residuals(graph, vectors(off[1], planar))) / (2 * h)
            for end in (0, 1):
                at = edges[:, end] == node
                J[at, end, :, axis] = numeric[at]
    weights = rng.uniform(0, 1, 5)
    W = weights[:, None, None] * graph.information
    found = linearized(graph, poses)
    assert np.allclose(found.chi2, edge_chi2(graph), rtol=1e-14)
    assert np.allclose(found.gradient(weights), np.einsum("esij,eik,ek->esj", J, W, residuals(graph)), atol=1e-6)
    assert np.allclose(found.hessian(weights), np.einsum("esik,eij,etjl->estkl", J, W, J), atol=1e-6)


def _nudged(T, node, axis, by):
    """One pose moved along an axis of the world (0 to 2), or turned about one of its own (3 to 5)."""
    from scipy.spatial.transform import Rotation

    moved = T.copy()
    if axis < 3:
        moved[node, axis, 3] += by
    else:
        moved[node, :3, :3] @= Rotation.from_rotvec(by * np.eye(3)[axis - 3]).as_matrix()
    return moved


def test_damping_saves_the_last_steps_from_a_bad_start():
    graph, truth = square(noise=1e-3)
    bad = truth + np.random.default_rng(3).normal(0, 0.5, truth.shape) * (np.arange(len(truth)) > 0)[:, None]
    found = gauss_newton(graph, bad, np.ones_like, 100, 1e-12)
    assert chi2(graph, found.poses) == pytest.approx(GtsamBatch().optimize(graph).chi2, rel=1e-6)


def test_steps_that_converge_fast_keep_their_equations(monkeypatch):
    """The chord method: more steps than factorisations, to the optimum of as many."""
    graph, truth = square(noise=0.05)
    bad = truth + np.random.default_rng(3).normal(0, 0.1, truth.shape) * (np.arange(len(truth)) > 0)[:, None]
    factored, factor = [], PoseEquations.factor
    monkeypatch.setattr(PoseEquations, "factor", lambda *given: factored.append(1) or factor(*given))
    found = gauss_newton(graph, bad, np.ones_like, 30, 1e-12)
    assert found.converged
    assert 1 < len(factored) < found.steps
    monkeypatch.setattr("omnilab_slam.least_squares.gauss_newton.CONTRACTION", 0)
    newton = gauss_newton(graph, bad, np.ones_like, 30, 1e-14)
    assert chi2(graph, found.poses) == pytest.approx(chi2(graph, newton.poses), rel=1e-12)
    assert np.allclose(found.poses, newton.poses, atol=1e-6)


@pytest.mark.parametrize("many", [0, 10**9])
@pytest.mark.parametrize("kind", [float, complex])
def test_equations_of_either_order_are_solved_as_dense_ones(many, kind, monkeypatch):
    monkeypatch.setattr("omnilab_slam.least_squares.equations.MANY", many)
    rng = np.random.default_rng(0)
    edges = np.array([[0, 1], [3, 1], [1, 2], [2, 4], [4, 0], [4, 0], [3, 5]])
    count, d = 6, 2
    J = rng.standard_normal((len(edges), d, 2 * d)) + (1j if kind is complex else 0) * rng.standard_normal(
        (7, d, 2 * d)
    )
    dense, right = np.zeros((count * d, count * d), kind), rng.standard_normal((count, d, 3)).astype(kind)
    H = J.conj().transpose(0, 2, 1) @ J
    for (i, j), block in zip(edges, H, strict=True):
        at = np.r_[i * d : i * d + d, j * d : j * d + d]
        dense[np.ix_(at, at)] += block
    dense[np.arange(12), np.arange(12)] *= 1.5
    blocks = H.reshape(-1, 2, d, 2, d).transpose(0, 1, 3, 2, 4)
    equations = PoseEquations(edges, count)
    found = equations.factor(blocks, damping=0.5).solve(right)
    assert np.allclose(found.reshape(-1, 3), np.linalg.solve(dense[d:, d:], right.reshape(-1, 3)[d:]))


# ------------------------------------------------------------------------------------------------------------- outliers
@pytest.mark.parametrize("kernel", [k for k in Kernel if k is not Kernel.none])
@pytest.mark.parametrize("start", [Start.given, Start.odometry])
def test_every_kernel_keeps_wrong_loops_out_from_any_start(kernel, start):
    graph, _ = square()
    clean = GtsamBatch().optimize(graph)
    found = GtsamBatch(kernel=kernel, start=start).optimize(with_wrong_loops(graph, 5))
    limit = 0.02 if kernel in REDESCENDING else 0.15
    assert _rms(found, clean) < limit
    assert found.weights[-5:].max() < 0.15
    assert np.median(found.weights[:-5]) > 0.5


def test_without_a_kernel_wrong_loops_ruin_the_map():
    graph, _ = square()
    assert _rms(GtsamBatch().optimize(with_wrong_loops(graph, 5)), GtsamBatch().optimize(graph)) > 0.5


def test_gnc_rejects_wrong_loops_and_keeps_the_others():
    graph, _ = square()
    found = GtsamGnc(start=Start.odometry).optimize(with_wrong_loops(graph, 5))
    assert not found.warnings
    assert (found.weights[-5:] == 0).all()
    assert found.weights[:-5].mean() > 0.95
    assert _rms(found, GtsamBatch().optimize(graph)) < 0.02


def test_isam2_takes_kernels_too():
    graph, _ = square()
    found = GtsamIsam2(kernel=Kernel.cauchy).optimize(with_wrong_loops(graph, 5))
    assert _rms(found, GtsamBatch().optimize(graph)) < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("backend", [GtsamBatch(kernel=Kernel.dcs), GtsamGnc()], ids=["dcs", "gnc"])
def test_manhattan_survives_a_tenth_of_wrong_loops(backend):
    graph = published("se_sync/manhattan.g2o")
    wrong = with_wrong_loops(graph, round(0.1 * is_loop(graph).sum()))
    found = backend.optimize(wrong)
    assert not found.warnings
    assert _rms(found, GtsamBatch().optimize(graph)) < 0.5


def _rms(found, other):
    """Of the positions, in metres; the first pose is the same."""
    return float(np.sqrt(np.mean(np.sum((found.poses - other.poses)[:, :2] ** 2, axis=1))))


# ------------------------------------------------------------------------------------------------------------- mishaps
def test_a_solver_that_fails_becomes_a_warning_and_the_poses_stay(monkeypatch):
    import gtsam

    graph, _ = square(laps=1)

    class Torn:
        def __init__(self, *arguments):
            raise RuntimeError("Indeterminate linear system\n detected")

    for name, backend in (
        ("LevenbergMarquardtOptimizer", GtsamBatch(kernel=Kernel.huber)),
        ("GncLMOptimizer", GtsamGnc()),
    ):
        monkeypatch.setattr(gtsam, name, Torn)
        found = backend.optimize(graph)
        assert "the solver failed (its linear equations are singular)" in found.warnings[0]
        assert "kept" in found.warnings[0]
        assert found.chi2 <= found.chi2_before


def test_a_solver_that_diverges_becomes_a_warning_and_the_poses_stay(monkeypatch):
    import gtsam

    graph, _ = square(laps=1)

    class Diverging:
        def __init__(self, factors, values, settings):
            self.start = values

        def optimize(self):
            values = gtsam.Values(self.start)
            values.update(3, gtsam.Pose2(1e9, 0, 0))
            return values

        def iterations(self):
            return 1

    monkeypatch.setattr(gtsam, "LevenbergMarquardtOptimizer", Diverging)
    found = GtsamBatch(kernel=Kernel.huber).optimize(graph)
    assert "diverged" in found.warnings[0]
    assert found.chi2 <= found.chi2_before


def test_a_pose_whose_edges_are_all_rejected_costs_no_map():
    """Node 4 hangs on two loop closures that contradict each other by far, nodes 3 and 5 on ones that fit."""
    edges = np.array([[0, 1], [1, 2], [0, 2], [0, 4], [2, 4], [1, 5], [5, 3]])
    poses = np.column_stack([np.arange(6), np.zeros(6), np.zeros(6)]).astype(float)
    motions = between(poses, edges)
    motions[3:5] += [[50.0, 0, 0], [0, 70.0, 1.0]]
    graph = PoseGraph(np.arange(6), poses, edges, motions, np.tile(1e4 * np.eye(3), (7, 1, 1)))
    for backend in (GtsamBatch(kernel=Kernel.tukey), GtsamGnc(), GtsamIsam2(kernel=Kernel.dcs)):
        found = backend.optimize(graph, covariances=True)
        assert np.isfinite(found.poses).all()
        assert np.allclose(found.poses[[1, 2]], poses[[1, 2]], atol=1e-2)


def test_lago_that_fails_is_one_sentence(monkeypatch):
    import gtsam

    def fail(factors):
        raise RuntimeError("no spanning tree")

    monkeypatch.setattr(gtsam.lago, "initialize", fail)
    with pytest.raises(DataError, match=r"no spanning tree.*start=odometry"):
        GtsamBatch(start=Start.lago).optimize(square(laps=1)[0])


def test_last_steps_and_covariances_that_fail_are_warnings(monkeypatch):
    import gtsam

    from omnilab_slam import solvers

    def fail(*arguments, **settings):
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr(solvers, "gauss_newton", fail)
    monkeypatch.setattr(gtsam, "Marginals", fail)
    graph, _ = square(laps=1)
    found = GtsamBatch(kernel=Kernel.huber).optimize(graph, covariances=True)
    assert ["singular" in sentence for sentence in found.warnings] == [True, True]
    assert found.covariances is None
    assert found.chi2 <= found.chi2_before
    assert "no covariances" in GtsamIsam2().optimize(graph, covariances=True).warnings[0]


def test_too_few_iterations_are_a_warning():
    graph = with_wrong_loops(square()[0], 5)
    assert "max_iterations=1" in GtsamBatch(max_iterations=1).optimize(graph).warnings[0]


def test_lago_is_for_planar_graphs():
    with pytest.raises(ConfigError, match="lago is for planar"):
        GtsamBatch(start=Start.lago).optimize(published("se_sync/tinyGrid3D.g2o"))


def test_numbers_beyond_all_measure_are_refused():
    graph, _ = square(laps=1)
    for backend in (GtsamBatch(), GtsamIsam2(), GtsamGnc()):
        with pytest.raises(DataError, match="usual size"):
            backend.optimize(replace(graph, information=graph.information * 1e303, motions=graph.motions * 1e10))


@pytest.mark.parametrize(
    "settings",
    [{"max_iterations": 0}, {"tolerance": -1.0}, {"kernel_width": 0.0}, {"kernel_width": float("nan")}],
)
def test_settings_that_cannot_be_are_one_sentence(settings):
    with pytest.raises(ConfigError, match=r"give .*"):
        GtsamBatch(**settings)


def test_settings_of_the_others_are_checked_too():
    with pytest.raises(ConfigError, match="probability"):
        GtsamGnc(probability=1.0)
    with pytest.raises(ConfigError, match="relinearize_every"):
        GtsamIsam2(relinearize_every=0)


def test_a_graph_whose_nodes_come_in_no_order_is_followed_along_its_edges():
    """Node 1 is joined to node 4 alone."""
    edges = np.array([[0, 2], [2, 3], [3, 4], [4, 1], [0, 4]])
    poses = np.column_stack([np.arange(5), np.zeros(5), np.zeros(5)]).astype(float)
    graph = PoseGraph(np.arange(5), poses, edges, between(poses, edges), np.tile(np.eye(3), (5, 1, 1)))
    assert np.allclose(GtsamIsam2().optimize(graph).poses, poses, atol=1e-6)
    assert edge_chi2(graph).max() == 0
