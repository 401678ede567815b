"""A back end: Levenberg-Marquardt on the whole pose graph, by one dense matrix."""

from dataclasses import dataclass

import numpy as np
from omnilab import (
    Backend,
    Floats,
    Optimized,
    PoseGraph,
    check_settings,
    setting,
)
from omnilab.limits import check_work
from omnilab.posegraph.graph import check_graph, chi2, matrices, residuals, vectors

STEP = 1e-6  # of derivatives by central differences, in metres and radians


@dataclass
class MyBackend:
    """Levenberg-Marquardt over all poses but the first (Grisetti et al., 2010).

    It starts from the poses that are given, and each step solves the normal equations as a
    dense matrix: for graphs of up to about a thousand poses. No edge is ever rejected.
    """

    max_iterations: int = setting(50, at_least=1)  # steps that are tried
    tolerance: float = setting(1e-9, at_least=0)  # of chi2's decrease, a share

    def __post_init__(self) -> None:
        check_settings(self)

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """The optimum of a planar or a spatial graph; DataError if it is unsound."""
        check_graph(graph)
        d = 3 if graph.planar else 6
        check_work(
            f"the dense normal equations of {len(graph)} poses",
            "give a smaller graph, or a sparse back end",
            memory=4 * 8 * (d * len(graph)) ** 2,
        )
        poses, before, damping, iterations = graph.poses, chi2(graph), 1e-6, 0
        least = before
        while iterations < self.max_iterations and damping < 1e9:
            iterations += 1
            H, b = _normal_equations(graph, poses, d)
            damped = H + damping * np.diag(np.diag(H))
            moved = _moved(poses, -np.linalg.solve(damped, b).reshape(-1, d))
            found = chi2(graph, moved)
            if found > least:  # too far: shorter steps, which point down more steeply
                damping *= 10
                continue
            done = least - found <= self.tolerance * least
            poses, least, damping = moved, found, damping / 10
            if done:
                break
        weights, spread = np.ones(len(graph.edges)), None
        if covariances:
            spread = _covariances(_normal_equations(graph, poses, d)[0], d)
        return Optimized(poses, before, least, iterations, weights, spread)


def _normal_equations(graph: PoseGraph, poses: Floats, d: int) -> tuple[Floats, Floats]:
    """J^T W J and J^T W e of all edges by all poses but the first."""
    count, edges = len(graph.edges), np.arange(len(graph.edges))
    ends = np.concatenate([poses[graph.edges[:, 0]], poses[graph.edges[:, 1]]])
    apart = PoseGraph(  # each edge with two poses of its own, which move one by one
        np.arange(2 * count),
        ends,
        np.column_stack([edges, count + edges]),
        graph.motions,
        graph.information,
    )
    J = np.zeros((count, d, len(poses), d))
    for side in (0, 1):
        for k in range(d):
            step = np.zeros((2, count, d))
            step[side, :, k] = STEP
            ahead = residuals(apart, _moved(ends, step.reshape(-1, d), first=0))
            back = residuals(apart, _moved(ends, -step.reshape(-1, d), first=0))
            J[edges, :, graph.edges[:, side], k] += (ahead - back) / (2 * STEP)
    own = J[:, :, 1:].reshape(count, d, -1)
    WJ = (graph.information @ own).reshape(count * d, -1)
    H = own.reshape(count * d, -1).T @ WJ
    return (H + H.T) / 2, WJ.T @ residuals(graph, poses).ravel()


def _moved(poses: Floats, steps: Floats, first: int = 1) -> Floats:
    """Poses (N, k), those from `first` on moved by (., d) in their own frames."""
    planar = poses.shape[1] == 3
    if not planar:  # a small rotation vector as a quaternion
        q = np.column_stack([steps[:, 3:] / 2, np.ones(len(steps))])
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        steps = np.column_stack([steps[:, :3], q])
    moved = poses.copy()
    moved[first:] = vectors(matrices(poses[first:]) @ matrices(steps), planar)
    return moved


def _covariances(H: Floats, d: int) -> Floats:
    """Marginal covariances (N, d, d); the first pose is known."""
    count = 1 + len(H) // d
    blocks = np.linalg.inv(H).reshape(count - 1, d, count - 1, d)
    known = 1e-12 * np.eye(d)
    others = np.arange(count - 1)
    marginals = (blocks[others, :, others] + blocks[others, :, others].mT) / 2
    return np.concatenate([known[None], marginals])


# a type checker compares it with the contract:
_: type[Backend] = MyBackend
