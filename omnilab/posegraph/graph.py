"""Pose graphs: composing motions, how far edges are off, first guesses, and what makes a graph sound.

Poses and motions are vectors (..., k), planar or spatial, as in `omnilab.api.PoseGraph`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints, PoseGraph
from omnilab.errors import DataError
from omnilab.geometry import planar_poses, poses, quaternion_xyzw, rotation_of_quaternion, wrap_angle

MOST_STEPS = 2  # between consecutive ids of one robot: a pose may be missing
QUATERNION_SLACK = 1e-3  # of a unit quaternion's length: files carry few digits


# ------------------------------------------------------------------------------------------------------------- motions
def matrices(pose: Floats) -> Floats:
    """Transforms (N, 4, 4) of poses or motions (N, k)."""
    if pose.shape[1] == 3:
        return planar_poses(np.column_stack([pose[:, :2], np.zeros(len(pose))]), pose[:, 2])
    return poses(pose[:, :3], rotation_of_quaternion(pose[:, 3:]))


def vectors(T: Floats, planar: bool) -> Floats:
    """Poses or motions (N, k) of transforms (N, 4, 4); headings in [-pi, pi)."""
    if planar:
        return np.column_stack([T[:, :2, 3], wrap_angle(np.arctan2(T[:, 1, 0], T[:, 0, 0]))])
    return np.column_stack([T[:, :3, 3], quaternion_xyzw(T)])


def inverse(T: Floats) -> Floats:
    """Inverses of rigid transforms (..., 4, 4)."""
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R
    out[..., :3, 3] = -(R @ T[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1
    return out


def between(pose: Floats, edges: Ints) -> Floats:
    """The motions (E, k) that poses (N, k) have along edges (E, 2)."""
    T = matrices(pose)
    return vectors(inverse(T[edges[:, 0]]) @ T[edges[:, 1]], pose.shape[1] == 3)


def residuals(graph: PoseGraph, pose: Floats | None = None) -> Floats:
    """How far each edge is off, (E, d): translation and rotation (vector) of measured^-1 from^-1 to, wrapped to half a turn."""
    at = graph.poses if pose is None else pose
    if graph.planar:
        return _planar_residuals(at, graph.edges, graph.motions)
    E = inverse(matrices(graph.motions)) @ matrices(between(at, graph.edges))
    q = quaternion_xyzw(E)  # w >= 0
    sine = np.linalg.norm(q[:, :3], axis=1)
    factor = np.divide(2 * np.arctan2(sine, q[:, 3]), sine, out=np.full(len(q), 2.0), where=sine > 1e-12)
    return np.column_stack([E[:, :3, 3], factor[:, None] * q[:, :3]])


def _planar_residuals(pose: Floats, edges: Ints, motions: Floats) -> Floats:
    """The same of poses and motions (., 3), in closed form: R_z^T (R_i^T (p_j - p_i) - t_z), and the heading."""
    x, y, turn = (pose[edges[:, 1]] - pose[edges[:, 0]]).T
    forward, left, angle = motions.T
    both, c, s = pose[edges[:, 0], 2] + angle, np.cos(angle), np.sin(angle)
    C, S = np.cos(both), np.sin(both)
    ahead, aside = C * x + S * y - (c * forward + s * left), C * y - S * x - (c * left - s * forward)
    return np.column_stack([ahead, aside, wrap_angle(turn - angle)])


def edge_chi2(graph: PoseGraph, pose: Floats | None = None) -> Floats:
    """e^T W e of each edge, (E,), e as in `residuals`."""
    e = residuals(graph, pose)
    return np.asarray(np.einsum("ei,ei->e", e, np.einsum("eij,ej->ei", graph.information, e)))


def chi2(graph: PoseGraph, pose: Floats | None = None) -> float:
    """The sum of e^T W e over all edges, of the graph's own poses or of others (N, k)."""
    return float(edge_chi2(graph, pose).sum())


def chi2_quantile(freedom: int, probability: float) -> float:
    """Of chi2's distribution, by Wilson and Hilferty (1931): in the upper tail no less than the exact one, by 7 % at most."""
    from statistics import NormalDist

    z, spread = NormalDist().inv_cdf(probability), 2 / (9 * freedom)
    return float(freedom * (1 - spread + z * spread**0.5) ** 3)


def is_loop(graph: PoseGraph) -> npt.NDArray[np.bool_]:
    """Which edges (E,) are loop closures: all that are not odometry, which joins two consecutive ids of one robot.

    Ids count up within a robot, in steps of 1 or of whatever is usual in the graph. Neighbouring rows more than two of
    these steps apart, or of keys with another character in the highest byte (GTSAM's), belong to two robots.
    """
    i, j = graph.edges.T
    if len(graph) < 2:
        return np.ones(len(graph.edges), bool)
    gap = np.abs(graph.ids[j] - graph.ids[i])
    usual = np.median(np.abs(np.diff(graph.ids)))
    one_robot = (gap <= MOST_STEPS * usual) & (graph.ids[i] >> 56 == graph.ids[j] >> 56)
    return np.asarray((np.abs(j - i) != 1) | ~one_robot)


# -------------------------------------------------------------------------------------------------------- first guesses
def dead_reckoning(graph: PoseGraph) -> Floats:
    """Poses (N, k) by chaining motions from the first pose: along a spanning tree that prefers odometry."""
    planar = graph.planar
    Z, T = matrices(graph.motions), matrices(graph.poses)
    Z_back = inverse(Z)
    for here, there, edge, forward in spanning_tree(graph):
        T[there] = T[here] @ (Z if forward else Z_back)[edge]
    return vectors(T, planar)


def spanning_tree(graph: PoseGraph) -> Iterator[tuple[int, int, int, bool]]:
    """From node 0 outwards: a node that is reached, the new one, the edge and whether it leads in that direction.

    Runs of odometry are followed before any other edge is (Dijkstra with costs 0 and 1).
    """
    loops = is_loop(graph).tolist()
    neighbours: list[list[tuple[int, int, bool]]] = [[] for _ in range(len(graph))]
    for edge, (i, j) in enumerate(graph.edges.tolist()):
        neighbours[i].append((j, edge, True))
        neighbours[j].append((i, edge, False))
    reached = [False] * len(graph)
    near, far = [(-1, 0, -1, True)], list[tuple[int, int, int, bool]]()
    while near or far:
        if not near:
            near, far = far[::-1], []
        here, node, edge, forward = near.pop()
        if reached[node]:
            continue
        reached[node] = True
        if here >= 0:
            yield here, node, edge, forward
        for other, along, ahead in neighbours[node]:
            if not reached[other]:
                (far if loops[along] else near).append((node, other, along, ahead))


class Arrival(NamedTuple):
    """A node in the order in which a robot reaches them. Nodes are numbered as they come, from 0."""

    node: int  # its row in the graph
    before: int  # the number of the one that its motion starts from
    motion: Floats  # (k,) measured, from there to here
    edges: Ints  # (e,) rows of the graph's edges that join it to what came before
    ends: Ints  # (e, 2) the numbers of their two nodes


def arrivals(graph: PoseGraph) -> Iterator[Arrival]:
    """The nodes after the first, each joined to one before: in their order where that is possible, else along the tree."""
    order = np.arange(len(graph))
    if len(np.unique(graph.edges.max(axis=1))) < len(graph) - 1:  # some node has no edge to a lower one
        order[1:] = [node for _, node, _, _ in spanning_tree(graph)]
    ends = np.argsort(order)[graph.edges]
    oldest, newest = ends.min(axis=1), ends.max(axis=1)
    ranked = np.argsort(newest, kind="stable")
    starts = np.searchsorted(newest[ranked], np.arange(len(graph) + 1))
    T = matrices(graph.motions)
    motions = vectors(np.where((ends[:, 1] > ends[:, 0])[:, None, None], T, inverse(T)), graph.planar)
    for number in range(1, len(graph)):
        own = ranked[starts[number] : starts[number + 1]]
        first = own[np.argmax(oldest[own])]  # from the one that came last
        yield Arrival(int(order[number]), int(oldest[first]), motions[first], own, ends[own])


def moved(pose: Floats, motion: Floats) -> Floats:
    """The pose (k,) that a motion (k,) leads to."""
    if len(pose) == 3:  # for maps that grow pose by pose, twenty times as quick
        (x, y, heading), (ahead, left, turn) = pose.tolist(), motion.tolist()
        c, s = math.cos(heading), math.sin(heading)
        return np.array(
            [x + c * ahead - s * left, y + s * ahead + c * left, math.remainder(heading + turn, 2 * math.pi)]
        )
    return np.asarray(vectors(matrices(pose[None]) @ matrices(motion[None]), planar=False)[0])


# ---------------------------------------------------------------------------------------------------------------- checks
def check_graph(graph: PoseGraph, name: str = "the graph") -> None:
    """DataError, with what is wrong, for a graph that has no unique optimum: shapes, numbers, information, parts."""
    count, k = graph.poses.shape
    d = 3 if k == 3 else 6
    shapes = {"ids": (count,), "edges": (len(graph.edges), 2), "motions": (len(graph.edges), k)}
    shapes["information"] = (len(graph.edges), d, d)
    for part, shape in shapes.items():
        found = np.shape(getattr(graph, part))
        if found != shape or k not in {3, 7}:
            raise DataError(f"{name} has {part} of shape {found} beside poses {graph.poses.shape}; give {shape}")
    if count == 0:
        raise DataError(f"{name} has no pose; give at least one")
    for part in ("poses", "motions", "information"):
        if not np.isfinite(getattr(graph, part)).all():
            raise DataError(f"{name} has {part} with NaN or infinity; give finite numbers")
    if k == 7:
        check_quaternions(np.concatenate([graph.poses, graph.motions])[:, 3:], name)
    check_edges(graph, name)
    check_information(graph, name)
    if islands := _islands(graph):
        raise DataError(
            f"{name} is in {1 + len(islands)} parts, with no edge between vertex {graph.ids[0]} and vertex"
            f" {graph.ids[islands[0]]}; join them, or give each a file of its own"
        )


def check_quaternions(xyzw: Floats, name: str) -> None:
    """DataError for quaternions (N, 4) that are no rotations."""
    length = np.linalg.norm(xyzw, axis=1)
    if (wrong := np.abs(length - 1) > QUATERNION_SLACK).any():
        raise DataError(f"{name} has a quaternion of length {length[wrong][0]:.4g}; normalise it to 1")


def check_edges(graph: PoseGraph, name: str) -> None:
    """DataError for edges that join nothing."""
    outside = (graph.edges < 0) | (graph.edges >= len(graph))
    if outside.any():
        raise DataError(
            f"{name} has an edge to row {graph.edges[outside][0]}, and {len(graph)} poses; give a row of them"
        )
    same = graph.edges[:, 0] == graph.edges[:, 1]
    if same.any():
        raise DataError(f"{name} has an edge from vertex {graph.ids[graph.edges[same][0, 0]]} to itself; remove it")


def check_information(graph: PoseGraph, name: str) -> None:
    """DataError for information matrices that are not symmetric or not positive definite."""
    W = graph.information
    scale = np.abs(W).max(axis=(1, 2), initial=0)
    skew = np.abs(W - W.transpose(0, 2, 1)).max(axis=(1, 2), initial=0) > 1e-9 * scale
    if skew.any():
        raise DataError(f"{name}: the information of {_edge(graph, skew)} is not symmetric; give (W + W^T) / 2")
    least = np.linalg.eigvalsh(W)[:, 0]
    if (nothing := scale == 0).any():
        raise DataError(
            f"{name}: the information of {_edge(graph, nothing)} is zero: it measured nothing; leave the edge out"
        )
    flat = least <= 1e-14 * scale
    if flat.any():
        raise DataError(
            f"{name}: the information of {_edge(graph, flat)} is not positive definite (eigenvalue {least[flat][0]:.3g});"
            " give a small positive one to what was not measured"
        )


def _edge(graph: PoseGraph, which: npt.NDArray[Any]) -> str:
    i, j = graph.ids[graph.edges[int(which.argmax())]]
    return f"the edge {i} {j}"


def _islands(graph: PoseGraph) -> list[int]:
    """The first node of each part that node 0 is not joined to."""
    nodes = np.arange(len(graph))
    first = nodes.copy()  # of what each node is known to be joined to
    while (ends := first[graph.edges]).size and (
        ends[:, 0] != ends[:, 1]
    ).any():  # at most half of the parts are left each time
        np.minimum.at(first, ends.max(axis=1), ends.min(axis=1))
        while ((nearer := first[first]) != first).any():
            first = nearer
    return [int(i) for i in np.flatnonzero(first == nodes)[1:]]
