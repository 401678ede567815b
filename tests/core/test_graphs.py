"""Pose graphs: motions, residuals, first guesses, the order of arrival, what is unsound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from omnilab.api import PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.graph import (
    arrivals,
    between,
    check_graph,
    chi2,
    dead_reckoning,
    edge_chi2,
    inverse,
    is_loop,
    matrices,
    moved,
    residuals,
    spanning_tree,
    vectors,
)


def graph_of(poses, pairs):
    """A graph whose motions are those of its poses, with unit information."""
    edges = np.array(pairs)
    d = 3 if poses.shape[1] == 3 else 6
    return PoseGraph(np.arange(len(poses)), poses, edges, between(poses, edges), np.tile(np.eye(d), (len(edges), 1, 1)))


def drawn(planar, count=6, seed=0):
    rng = np.random.default_rng(seed)
    if planar:
        return rng.uniform(-3, 3, (count, 3))
    return np.column_stack([rng.uniform(-3, 3, (count, 3)), Rotation.random(count, rng=rng).as_quat()])


RING = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 4)]


def test_a_planar_error_by_hand():
    """From (1, 2) facing +y to (0, 4) facing -x is 2 ahead, 1 to the left, a quarter turn; 1.5 ahead was measured."""
    poses = np.array([[1.0, 2.0, np.pi / 2], [0.0, 4.0, np.pi]])
    assert np.allclose(between(poses, np.array([[0, 1]])), [[2, 1, np.pi / 2]])
    graph = replace(graph_of(poses, [(0, 1)]), motions=np.array([[1.5, 1.0, 0.0]]))
    assert np.allclose(residuals(graph), [[0.5, 0, np.pi / 2]])
    graph = replace(graph, information=np.array([[[2.0, 0, 1], [0, 3, 0], [1, 0, 5]]]))
    assert chi2(graph) == pytest.approx(2 * 0.25 + 2 * 0.5 * np.pi / 2 + 5 * np.pi**2 / 4)


def test_the_error_is_taken_in_the_frame_of_the_measured_pose():
    poses = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    graph = replace(graph_of(poses, [(0, 1)]), motions=np.array([[0.0, 0.0, np.pi / 2]]))
    assert np.allclose(residuals(graph), [[0, -1, -np.pi / 2]])


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_headings_wrap(measured, actual):
    graph = replace(graph_of(np.array([[0.0, 0, 0], [0, 0, actual]]), [(0, 1)]), motions=np.array([[0.0, 0, measured]]))
    error = residuals(graph)[0, 2]
    assert abs(error) <= np.pi
    assert np.isclose(np.cos(error), np.cos(actual - measured))
    assert np.isclose(np.sin(error), np.sin(actual - measured), atol=1e-9)


def test_spatial_errors_are_scipys():
    poses, motions = drawn(planar=False), drawn(planar=False, seed=1)
    graph = replace(graph_of(poses, RING[:6]), motions=motions)
    i, j = graph.edges.T
    R, Z = Rotation.from_quat(poses[:, 3:]), Rotation.from_quat(motions[:, 3:])
    turned = (Z.inv() * R[i].inv() * R[j]).as_rotvec()
    shifted = Z.inv().apply(R[i].inv().apply(poses[j, :3] - poses[i, :3]) - motions[:, :3])
    assert np.allclose(residuals(graph), np.column_stack([shifted, turned]))
    assert chi2(graph) == pytest.approx((shifted**2).sum() + (turned**2).sum())


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-5, 3.1])
def test_spatial_rotations_of_any_size(turn):
    identity = np.array([0.0, 0, 0, 0, 0, 0, 1])
    poses = np.array([identity, [0, 0, 0, *Rotation.from_rotvec([0, turn, 0]).as_quat()]])
    graph = replace(graph_of(poses, [(0, 1)]), motions=identity[None])
    assert np.allclose(residuals(graph), [[0, 0, 0, 0, turn, 0]], atol=1e-12)


@pytest.mark.parametrize("planar", [True, False])
def test_vectors_and_matrices_are_the_same_poses(planar):
    poses = drawn(planar)
    T = matrices(poses)
    assert np.allclose(matrices(vectors(T, planar)), T)
    assert np.allclose(inverse(T) @ T, np.eye(4))
    there = moved(poses[0], between(poses, np.array([[0, 1]]))[0])
    assert np.allclose(matrices(there[None]), T[1:2])


@pytest.mark.parametrize("planar", [True, False])
def test_dead_reckoning_meets_poses_that_edges_fit(planar):
    graph = graph_of(drawn(planar), [(1, 0), (1, 2), (3, 2), (5, 3), (3, 4)])  # backwards, too
    start = np.tile(graph.poses[0], (6, 1))
    assert np.allclose(matrices(dead_reckoning(replace(graph, poses=start))), matrices(graph.poses))
    assert edge_chi2(graph).max() < 1e-20


def test_odometry_comes_before_loop_closures():
    tree = list(spanning_tree(graph_of(drawn(True), RING)))
    assert [(here, there) for here, there, _, _ in tree] == [(i, i + 1) for i in range(5)]


def test_loop_closures_are_what_does_not_lead_to_a_neighbour():
    assert is_loop(graph_of(drawn(True), [*RING, (2, 1)])).tolist() == [False] * 5 + [True, True, False]


def test_nodes_arrive_in_order_where_each_is_joined_to_an_earlier_one():
    graph = graph_of(drawn(True), RING)
    found = list(arrivals(graph))
    assert [a.node for a in found] == [1, 2, 3, 4, 5]
    assert [a.before for a in found] == [0, 1, 2, 3, 4]
    assert [a.edges.tolist() for a in found] == [[0], [1], [2], [3, 6], [4, 5]]
    assert np.allclose([a.motion for a in found], graph.motions[:5])


def test_else_they_arrive_along_the_edges_numbered_as_they_come():
    graph = graph_of(drawn(True, 4), [(0, 2), (3, 2), (1, 3)])
    found = list(arrivals(graph))
    assert [a.node for a in found] == [2, 3, 1]
    assert [a.ends.tolist() for a in found] == [[[0, 1]], [[2, 1]], [[3, 2]]]
    for a, start in zip(found, [0, 2, 3], strict=True):
        assert np.allclose(matrices(moved(graph.poses[start], a.motion)[None]), matrices(graph.poses[[a.node]]))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            {"edges": np.array([(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (1, 2)])},
            "2 parts.*vertex 0 and vertex 3",
        ),
        ({"edges": np.array([*RING[:6], (2, 2)])}, "vertex 2 to itself"),
        ({"edges": np.array([*RING[:6], (2, 9)])}, "row 9"),
        ({"information": np.tile(np.diag([1.0, 1, 0]), (7, 1, 1))}, "edge 0 1 is not positive definite"),
        ({"information": np.tile(np.diag([1.0, -1, 1]), (7, 1, 1))}, "not positive definite"),
        ({"information": np.tile(np.eye(3) + np.eye(3, k=1), (7, 1, 1))}, "not symmetric"),
        ({"motions": np.full((7, 3), np.nan)}, "motions with NaN"),
        ({"motions": np.zeros((6, 3))}, "motions of shape"),
        ({"poses": np.zeros((6, 4))}, "beside poses"),
    ],
)
def test_unsound_graphs_are_refused(change, reason):
    graph = graph_of(drawn(True), RING)
    check_graph(graph)
    with pytest.raises(DataError, match=reason):
        check_graph(replace(graph, **change))


def test_quaternions_must_be_unit():
    graph = graph_of(drawn(False), RING)
    with pytest.raises(DataError, match="length 2"):
        check_graph(replace(graph, poses=graph.poses * [1, 1, 1, 2, 2, 2, 2]))
