"""The last Gauss-Newton steps, on the error that `omnilab.posegraph.graph.residuals` measures, as g2o has it.

GTSAM minimises the logarithm of an edge's error. Where loop closures are off by many degrees, the optimum of the other
is elsewhere: on Manhattan's 3500 poses its chi2 is 10 % lower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Ints, PoseGraph
from omnilab.posegraph.graph import edge_chi2, inverse, matrices, residuals, vectors

PLANAR = np.array([0, 1, 5])  # of x, y, z and a rotation vector
MAX_DAMPING = 1e6


class GaussNewtonResult(NamedTuple):
    """Where the last Gauss-Newton steps ended."""

    poses: Floats  # (N, k)
    steps: int


class PoseEquations:
    """Normal equations of a pose graph of N poses: a block for each pose but the first, which stays, and for each edge.

    The order of elimination is GTSAM's COLAMD of the poses, worked out once: SuperLU's own of all variables takes time that grows with the
    square of their number.
    """

    def __init__(self, edges: Ints, count: int) -> None:
        self._edges, self._order = edges, elimination_order(edges)
        place = np.full(count, -1)
        place[self._order] = np.arange(count - 1)
        rows, columns = np.repeat(place[edges], 2, axis=1).ravel(), np.tile(place[edges], 2).ravel()  # of (E, 2, 2)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        blocks, block = np.unique(rows[kept] * count + columns[kept], return_inverse=True)
        self._summands = kept[np.argsort(block, kind="stable")]
        self._starts = np.searchsorted(np.sort(block), np.arange(len(blocks)))
        self._columns = (blocks % count).astype(np.int32)
        self._rows = np.searchsorted(blocks // count, np.arange(count)).astype(np.int32)
        self._diagonal = np.flatnonzero(blocks // count == blocks % count)

    def solve(self, H: Floats, right: Floats, damping: float = 0.0) -> Floats:
        """x (N - 1, d, c) of all poses but the first: the sum of the edges' H (E, 2, 2, d, d), its diagonal raised, times x is `right` (N, d, c)."""
        from scipy.sparse import bsr_array, csc_array
        from scipy.sparse.linalg import splu

        d, c = right.shape[1:]
        blocks = np.add.reduceat(H.reshape(-1, d, d)[self._summands], self._starts, axis=0)
        k = np.arange(d)
        blocks[self._diagonal[:, None], k, k] *= 1 + damping
        rows = bsr_array((blocks, self._columns, self._rows), shape=(d * len(self._order),) * 2).tocsr()
        matrix = csc_array((rows.data, rows.indices, rows.indptr), shape=rows.shape)  # it is symmetric
        factor = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        x = np.empty((len(self._order), d, c))
        x[self._order - 1] = factor.solve(right[self._order].reshape(-1, c)).reshape(-1, d, c)
        return x

    def right(self, g: Floats) -> Floats:
        """The right side (N, d, c) of what each edge adds to those of its two poses, (E, 2, d, c)."""
        count, cells = len(self._order) + 1, g[0, 0].size
        index = cells * self._edges[:, :, None] + np.arange(cells)
        return np.asarray(np.bincount(index.ravel(), g.ravel(), cells * count), float).reshape(count, *g.shape[2:])


def elimination_order(edges: Ints) -> Ints:
    """The poses (N - 1,) but the first in an order that leaves a sparse factor (COLAMD; Davis et al., 2004)."""
    import gtsam

    graph = gtsam.SymbolicFactorGraph()
    for i, j in edges.tolist():
        graph.push_factor(i, j)
    order = gtsam.Ordering.ColamdSymbolicFactorGraph(graph)
    found = np.array([order.at(k) for k in range(order.size())], int)
    return found[found > 0]


def gauss_newton(
    graph: PoseGraph, poses: Floats, weigh: Callable[[Floats], Floats], max_steps: int, tolerance: float,
    enough: float = -np.inf, equations: PoseEquations | None = None,
) -> GaussNewtonResult:  # fmt: skip
    """Damped Gauss-Newton from poses (N, k), the first of which stays; `weigh` turns chi2 of the edges (E,) into weights (E,).

    Steps are damped until they lower the weighted sum (Levenberg, 1944), and end where that falls by less than
    `tolerance` of itself, or once it is at most `enough`. `equations` may come from another solution of the same graph.
    """
    equations, edge_errors = equations or PoseEquations(graph.edges, len(graph)), edge_chi2(graph, poses)
    weights = weigh(edge_errors)
    cost, damping, steps = float(weights @ edge_errors), 0.0, 0
    while steps < max_steps and damping < MAX_DAMPING:
        steps += 1
        moved = _stepped(graph, equations, poses, weights, damping)
        edge_errors = edge_chi2(graph, moved)
        if not weights @ edge_errors < cost:
            damping = max(10 * damping, 1e-4)
            continue
        gain, poses, damping = cost - float(weights @ edge_errors), moved, damping / 10 if damping > 1e-4 else 0.0
        if gain <= tolerance * cost or cost - gain <= enough:
            break
        weights = weigh(edge_errors)
        cost = float(weights @ edge_errors)
    return GaussNewtonResult(poses, steps)


def _stepped(graph: PoseGraph, equations: PoseEquations, poses: Floats, weights: Floats, damping: float) -> Floats:
    """Poses (N, k) after one Gauss-Newton step, the diagonal raised by a damping."""
    T = matrices(poses)
    e, J = residuals(graph, poses), jacobians(graph, T)
    WJ = (weights[:, None, None] * graph.information)[:, None] @ J  # (E, 2, d, d)
    H = np.swapaxes(J[:, :, None], -1, -2) @ WJ[:, None]  # (E, 2, 2, d, d): from and to, by from and to
    g = np.swapaxes(WJ, -1, -2) @ e[:, None, :, None]  # (E, 2, d, 1)
    step = equations.solve(H, -equations.right(g), damping)
    return _retracted(T, step[..., 0], graph.planar)


def jacobians(graph: PoseGraph, T: Floats) -> Floats:
    """Jacobians (E, 2, d, d) of the residuals by the first and the second pose of their edges.

    A pose changes by a translation in the world and a rotation (vector) in its own frame.
    """
    Ti, Tj, R_z = T[graph.edges[:, 0]], T[graph.edges[:, 1]], matrices(graph.motions)[:, :3, :3]
    R_i, R_j = Ti[:, :3, :3], Tj[:, :3, :3]
    to_z = np.swapaxes(R_i @ R_z, -1, -2)
    inwards = inverse(Ti)[:, :3, :3] @ (Tj - Ti)[:, :3, 3, None]
    full = residuals(graph, vectors(T, graph.planar))
    rotation = np.column_stack([np.zeros((len(full), 2)), full[:, 2]]) if graph.planar else full[:, 3:]
    right = _right_jacobian_inverse(rotation)
    J = np.zeros((len(Ti), 2, 6, 6))
    J[:, 0, :3, :3], J[:, 1, :3, :3] = -to_z, to_z
    J[:, 0, :3, 3:] = np.swapaxes(R_z, -1, -2) @ _skew(inwards[..., 0])
    J[:, 0, 3:, 3:] = -right @ np.swapaxes(R_j, -1, -2) @ R_i
    J[:, 1, 3:, 3:] = right
    return J[:, :, PLANAR[:, None], PLANAR] if graph.planar else J


def _retracted(T: Floats, step: Floats, planar: bool) -> Floats:
    """Poses (N, k) of transforms (N, 4, 4) of which all but the first have moved by steps (N - 1, d)."""
    full = step
    if planar:
        full = np.zeros((len(step), 6))
        full[:, PLANAR] = step
    moved = T.copy()
    moved[1:, :3, 3] += full[:, :3]
    moved[1:, :3, :3] @= _exponential(full[:, 3:])
    return vectors(moved, planar)


def _skew(v: Floats) -> Floats:
    """Skew-symmetric matrices (N, 3, 3) of v (N, 3): they multiply as v does in a cross product."""
    out = np.zeros((len(v), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = v.T
    return out - np.swapaxes(out, -1, -2)


def _exponential(rotation: Floats) -> Floats:
    """Exponential map: rotations (N, 3, 3) of rotation vectors (N, 3) (Rodrigues)."""
    angle = np.linalg.norm(rotation, axis=1)[:, None, None]
    K = _skew(rotation)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * K @ K)


def _right_jacobian_inverse(rotation: Floats) -> Floats:
    """Inverse right Jacobian (N, 3, 3) of SO(3) at rotation vectors (N, 3)."""
    angle = np.linalg.norm(rotation, axis=1)[:, None, None]
    safe = np.where(angle > 1e-4, angle, 1.0)
    factor = np.where(angle > 1e-4, (1 - safe / 2 / np.tan(safe / 2)) / safe**2, 1 / 12)
    K = _skew(rotation)
    return np.asarray(np.eye(3) + K / 2 + factor * K @ K)
