"""Chordal initialisation: rotations by linear least squares, then positions (Martinec and Pajdla, 2007; Carlone et al., 2015).

It needs no first guess, so the optimum that is reached from it does not depend on how far odometry has drifted.
"""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Ints, PoseGraph
from omnilab.posegraph.graph import matrices, vectors
from omnilab_slam.least_squares.equations import Numbers, PoseEquations


def chordal(graph: PoseGraph, equations: PoseEquations | None = None) -> Floats:
    """Poses (N, k), planar or spatial, from the measured motions alone; the first pose is the graph's own.

    RuntimeError where the linear problems have no unique solution.
    """
    d = 2 if graph.planar else 3
    first, Z = matrices(graph.poses[:1])[0], matrices(graph.motions)
    equations = equations or PoseEquations(graph.edges, len(graph))
    T = np.tile(np.eye(4), (len(graph), 1, 1))
    if graph.planar:
        T[:, :2, :2] = _planar_rotations(graph, equations)
    else:
        T[:, :3, :3] = _rotations(graph, equations, Z[:, :3, :3], first[:3, :3])
    T[:, 2, 3] = first[2, 3]
    T[:, :d, 3] = _positions(graph, equations, T[:, :d, :d], Z[:, :d, :d], Z[:, :d, 3], first[:d, 3])
    poses = vectors(T, graph.planar)
    poses[0] = graph.poses[0]
    return poses


def _planar_rotations(graph: PoseGraph, equations: PoseEquations) -> Floats:
    """As `_rotations`, (N, 2, 2), of rotations as complex numbers r_j = r_i exp(i z): a quarter of the numbers."""
    turn = np.exp(1j * graph.motions[:, 2])[:, None, None]
    one, first = np.ones_like(turn), np.exp(1j * graph.poses[0, 2]).reshape(1, 1)
    w = graph.information[:, 2, 2, None, None]
    r = _least_squares(equations, graph.edges, -turn, one, w, np.zeros_like(turn), first)[:, 0, 0]
    r /= np.abs(r)
    return np.stack([r.real, -r.imag, r.imag, r.real], axis=1).reshape(-1, 2, 2)


def _rotations(graph: PoseGraph, equations: PoseEquations, R_z: Floats, first: Floats) -> Floats:
    """Rotations (N, 3, 3) nearest to the matrices that minimise the sum of w |R_j - R_i R_z|^2 (Frobenius), R_0 being known.

    The weight w of an edge is the mean information of its rotation.
    """
    w = np.trace(graph.information[:, 3:, 3:], axis1=1, axis2=2) / 3
    # the rows of the matrices are independent of each other: the columns of the unknown are R_i^T
    to = np.broadcast_to(np.eye(3), R_z.shape)
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
    R_i, W = R[graph.edges[:, 0]], graph.information[:, :d, :d]
    b = R_i @ t_z[:, :, None]
    if np.array_equal(W, W[:, :1, :1] * np.eye(d)):  # the same in all directions: coordinates are independent
        one = np.ones((len(b), 1, 1))
        return _least_squares(equations, graph.edges, -one, one, W[:, :1, :1], np.swapaxes(b, 1, 2), first[None])[:, 0]
    A = R_i @ R_z  # of the measured pose, in the world
    one = np.broadcast_to(np.eye(d), R_z.shape)
    W = A @ W @ np.swapaxes(A, 1, 2)
    return _least_squares(equations, graph.edges, -one, one, W, b, first[:, None])[:, :, 0]


def _least_squares(
    equations: PoseEquations, edges: Ints, A: Numbers, B: Numbers, W: Floats, b: Numbers, first: Numbers
) -> Numbers:
    """x (N, d, c) that minimises the sum over edges of |A x_i + B x_j - b|^2_W, with x_0 = `first` (d, c).

    A, B and W are (E, d, d), b is (E, d, c), real or complex.
    """
    J = np.stack([A, B], axis=1)  # (E, 2, d, d)
    J_T, WJ = np.swapaxes(J, -1, -2).conj(), W[:, None] @ J
    H = J_T[:, :, None] @ WJ[:, None]  # (E, 2, 2, d, d)
    g = np.swapaxes(WJ, -1, -2).conj() @ b[:, None]  # (E, 2, d, c)
    known = edges == 0
    g[known[:, 0]] -= H[known[:, 0], :, 0] @ first
    g[known[:, 1]] -= H[known[:, 1], :, 1] @ first
    return np.concatenate([first[None], equations.factor(H).solve(equations.right(g))])
