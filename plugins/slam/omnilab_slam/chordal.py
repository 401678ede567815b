"""Chordal initialisation: rotations by linear least squares, then positions (Martinec and Pajdla, 2007; Carlone et al., 2015).

It needs no first guess, so the optimum that is reached from it does not depend on how far odometry has drifted.
"""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Ints, PoseGraph
from omnilab.posegraph.graph import matrices, vectors
from omnilab_slam.gauss_newton import PoseEquations


def chordal(graph: PoseGraph, equations: PoseEquations | None = None) -> Floats:
    """Poses (N, k), planar or spatial, from the measured motions alone; the first pose is the graph's own.

    RuntimeError where the linear problems have no unique solution.
    """
    d = 2 if graph.planar else 3
    first, Z = matrices(graph.poses[:1])[0], matrices(graph.motions)
    equations = equations or PoseEquations(graph.edges, len(graph))
    T = np.tile(np.eye(4), (len(graph), 1, 1))
    T[:, :d, :d] = _rotations(graph, equations, Z[:, :d, :d], first[:d, :d])
    T[:, 2, 3] = first[2, 3]
    T[:, :d, 3] = _positions(graph, equations, T[:, :d, :d], Z[:, :d, :d], Z[:, :d, 3], first[:d, 3])
    poses = vectors(T, graph.planar)
    poses[0] = graph.poses[0]
    return poses


def _rotations(graph: PoseGraph, equations: PoseEquations, R_z: Floats, first: Floats) -> Floats:
    """Rotations (N, d, d) nearest to the matrices that minimise the sum of w |R_j - R_i R_z|^2 (Frobenius), R_0 being known.

    The weight w of an edge is the mean information of its rotation.
    """
    d = len(first)
    spread = graph.information[:, d:, d:]
    w = np.trace(spread, axis1=1, axis2=2) / spread.shape[1]
    # the rows of the matrices are independent of each other: the columns of the unknown are R_i^T
    to = np.broadcast_to(np.eye(d), R_z.shape)
    M = _least_squares(
        equations, graph.edges, -np.swapaxes(R_z, 1, 2), to, w[:, None, None] * to, np.zeros_like(R_z), first.T
    )
    U, _, Vt = np.linalg.svd(np.swapaxes(M, 1, 2))
    U[:, :, -1] *= np.linalg.det(U @ Vt)[:, None]
    return np.asarray(U @ Vt)


def _positions(
    graph: PoseGraph, equations: PoseEquations, R: Floats, R_z: Floats, t_z: Floats, first: Floats
) -> Floats:
    """Positions (N, d) that minimise the sum of e^T W e with e = R_z^T (R_i^T (p_j - p_i) - t_z), p_0 being known."""
    d = len(first)
    R_i = R[graph.edges[:, 0]]
    A = R_i @ R_z  # of the measured pose, in the world
    W = A @ graph.information[:, :d, :d] @ np.swapaxes(A, 1, 2)
    one = np.broadcast_to(np.eye(d), R_z.shape)
    return _least_squares(equations, graph.edges, -one, one, W, R_i @ t_z[:, :, None], first[:, None])[:, :, 0]


def _least_squares(
    equations: PoseEquations, edges: Ints, A: Floats, B: Floats, W: Floats, b: Floats, first: Floats
) -> Floats:
    """x (N, d, c) that minimises the sum over edges of |A x_i + B x_j - b|^2_W, with x_0 = `first` (d, c).

    A, B and W are (E, d, d), b is (E, d, c).
    """
    J = np.stack([A, B], axis=1)  # (E, 2, d, d)
    WJ = W[:, None] @ J
    H = np.swapaxes(J[:, :, None], -1, -2) @ WJ[:, None]  # (E, 2, 2, d, d)
    g = np.swapaxes(WJ, -1, -2) @ b[:, None]  # (E, 2, d, c)
    known = edges == 0
    g[known[:, 0]] -= H[known[:, 0], :, 0] @ first
    g[known[:, 1]] -= H[known[:, 1], :, 1] @ first
    return np.concatenate([first[None], equations.solve(H, equations.right(g))])
