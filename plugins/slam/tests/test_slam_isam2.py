"""iSAM2: one pass, Cholesky unless it fails, several robots, and the optimum that it does not reach."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnilab.api import PoseGraph
from omnilab.posegraph.graph import between, dead_reckoning, is_loop
from omnilab_slam import GtsamBatch, GtsamGnc, GtsamIsam2, isam2, solvers
from omnilab_slam.kernels import Kernel


def helix(count=40, lap=10, noise=0.01, seed=0):
    """A drive up a helix, with loop closures to the lap below."""
    rng, angle = np.random.default_rng(seed), np.arange(count) * 2 * np.pi / lap
    poses = np.column_stack(
        [5 * np.cos(angle), 5 * np.sin(angle), angle / 4, Rotation.from_euler("z", angle[:, None]).as_quat()]
    )
    edges = np.array([*((i, i + 1) for i in range(count - 1)), *((i, i + lap) for i in range(count - lap))])
    motions = between(poses, edges)
    motions[:, :3] += noise * rng.standard_normal((len(edges), 3))
    graph = PoseGraph(np.arange(count), poses, edges, motions, np.tile(np.eye(6) / noise**2, (len(edges), 1, 1)))
    return replace(graph, poses=dead_reckoning(graph))


def two_robots():
    """One robot drives ten metres, another in parallel; the first sees the second, and a wrong edge joins end to start."""
    ids = np.array([*range(11), *range(1000, 1011)])
    poses = np.column_stack([np.tile(np.arange(11.0), 2), np.repeat([0.0, 2.0], 11), np.zeros(22)])
    pairs = [
        *pairwise(range(11)),
        *pairwise(range(11, 22)),
        *((i, 11) for i in (0, 1, 2, 3)),
        (5, 16),
        (8, 19),
        (10, 11),
    ]
    edges = np.array(pairs)
    motions = between(poses, edges)
    motions[-1] = [3, 3, 1]
    graph = PoseGraph(ids, poses, edges, motions, np.tile(np.diag([400.0, 400, 3000]), (len(edges), 1, 1)))
    return replace(graph, poses=dead_reckoning(graph)), poses


def factorizations(monkeypatch):
    """Those of the trees that are made."""
    made, plain = [], solvers.empty_tree

    def empty_tree(threshold, every, factorization="QR"):
        made.append(factorization)
        return plain(threshold, every, factorization)

    monkeypatch.setattr(isam2, "empty_tree", empty_tree)
    return made


def test_spatial_graphs_are_solved_by_cholesky_to_the_poses_of_qr(monkeypatch):
    graph, made = helix(), factorizations(monkeypatch)
    found = GtsamIsam2().optimize(graph)
    assert made == ["CHOLESKY"]
    monkeypatch.setattr(isam2, "empty_tree", lambda threshold, every, _: solvers.empty_tree(threshold, every))
    by_qr = GtsamIsam2().optimize(graph)
    assert found.chi2 == pytest.approx(by_qr.chi2, rel=1e-9)
    assert np.allclose(found.poses, by_qr.poses, atol=1e-7)


class Failing:
    """A Bayes tree whose nth update fails, as GTSAM's does by Cholesky."""

    def __init__(self, tree, at):
        self._tree, self._left = tree, at

    def update(self, *arguments):
        self._left -= 1
        if self._left == 0:
            raise RuntimeError("Indeterminate linear system detected while working near variable 7")
        return self._tree.update(*arguments)

    def __getattr__(self, name):
        return getattr(self._tree, name)


@pytest.mark.parametrize("at", [2, 20, 42])  # the second pose, one amid, one of the last updates without a pose
def test_where_cholesky_fails_qr_goes_on_and_nothing_is_lost(monkeypatch, at):
    graph, made = helix(), []
    expected = GtsamIsam2().optimize(graph)

    def empty_tree(threshold, every, factorization):
        made.append(factorization)
        tree = solvers.empty_tree(threshold, every, factorization)
        return Failing(tree, at) if factorization == "CHOLESKY" else tree

    monkeypatch.setattr(isam2, "empty_tree", empty_tree)
    found = GtsamIsam2().optimize(graph)
    assert made == ["CHOLESKY", "QR"]
    assert not found.warnings
    assert found.chi2 == pytest.approx(expected.chi2, rel=1e-3)


def test_where_qr_fails_too_the_pose_stays_where_it_was_guessed_and_it_is_said(monkeypatch):
    graph = helix()
    monkeypatch.setattr(isam2, "empty_tree", lambda *settings: Failing(solvers.empty_tree(*settings), 8))
    found = GtsamIsam2().optimize(graph)
    assert "could not be added (its linear equations are singular); it stays where it was guessed" in found.warnings[0]
    assert np.isfinite(found.poses).all()


def test_planar_graphs_are_solved_by_cholesky_until_it_fails_and_that_is_said(monkeypatch):
    graph, _ = two_robots()
    graph, made = replace(graph, motions=between(two_robots()[1], graph.edges)), factorizations(monkeypatch)
    assert not GtsamIsam2().optimize(graph).notes[:-1]
    assert made == ["CHOLESKY"]
    information = graph.information.copy()
    information[:9] = np.diag([4e8, 4e8, 20])  # lengths that are known 4500 times as well as headings: GTSAM gives up
    uneven = replace(graph, information=information)
    found = GtsamIsam2().optimize(uneven)
    assert made == ["CHOLESKY", "CHOLESKY", "QR"]
    assert found.notes[0] == "Cholesky fails at pose 3: from there on iSAM2 solves by QR, which takes longer"
    assert not found.warnings
    assert found.poses == pytest.approx(GtsamBatch().optimize(uneven).poses, abs=1e-6)
    again = GtsamIsam2().optimize(uneven)
    assert np.array_equal(again.poses, found.poses)


@pytest.mark.parametrize("backend", [GtsamGnc(), GtsamBatch(kernel=Kernel.dcs), GtsamIsam2(kernel=Kernel.huber)])
def test_an_edge_from_the_last_pose_of_one_robot_to_the_first_of_the_next_can_be_rejected(backend):
    graph, truth = two_robots()
    found = backend.optimize(graph)
    assert found.weights[-1] < 0.5
    assert found.weights[:-1].min() > 0.5
    assert np.abs(found.poses - truth).max() < (0.6 if isinstance(backend, GtsamIsam2) else 1e-3)
    assert np.array_equal(found.trusted, ~is_loop(graph))
    assert "1 of 7 loop closures are rejected" in found.notes[-1]
    assert "the 20 between consecutive ids of one robot are odometry and trusted" in found.notes[-1]
    one = replace(graph, ids=np.arange(22))  # ids that count on: the edge is odometry, and trusted
    assert backend.optimize(one).weights[-1] == 1
