"""GTSAM's solvers, guarded: a failure becomes a warning, and the poses they started from are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.graph import chi2, edge_chi2
from omnilab_slam.factors import marginals, poses_of, values_of
from omnilab_slam.least_squares.equations import PoseEquations
from omnilab_slam.least_squares.gauss_newton import gauss_newton

FAILURES = (RuntimeError, ValueError, IndexError)  # what GTSAM raises
MAX_STEPS = 20  # of Gauss-Newton, at the end
TOLERANCE = 1e-6  # relative decrease of chi2 that ends them: steps converge quadratically


class Solved(NamedTuple):
    """Where a solver ended, and what went wrong."""

    values: Any  # gtsam.Values
    iterations: int
    warnings: list[str]


def parameters(max_iterations: int, tolerance: float) -> Any:
    """GTSAM's settings of Levenberg-Marquardt."""
    import gtsam

    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(max_iterations)
    settings.setRelativeErrorTol(tolerance)
    return settings


def guarded(start: Any, solve: Callable[[], tuple[Any, int]], cost: Callable[[Any], float]) -> Solved:
    """Values and iterations of `solve`; the start and a warning where it fails, or where the cost has grown."""
    try:
        optimum, iterations = solve()
    except FAILURES as error:
        return Solved(start, 0, [f"the solver failed ({brief(error)}); the poses it started from are kept"])
    before, after = cost(start), cost(optimum)
    if after <= before:
        return Solved(optimum, iterations, [])
    sentence = f"the solver diverged (error {before:.4g}, then {after:.4g}); the poses it started from are kept"
    return Solved(start, iterations, [sentence])


def levenberg_marquardt(factors: Any, start: Any, max_iterations: int, tolerance: float) -> Solved:
    """Levenberg-Marquardt on a factor graph, from GTSAM's values."""
    import gtsam

    def solve() -> tuple[Any, int]:
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters(max_iterations, tolerance))
        return optimizer.optimize(), optimizer.iterations()

    solved = guarded(start, solve, factors.error)
    if solved.iterations >= max_iterations:
        solved.warnings.append(f"the solver stopped after max_iterations={max_iterations}; give more")
    return solved


def empty_tree(relinearize_threshold: float, relinearize_every: int, factorization: str = "QR") -> Any:
    """iSAM2's Bayes tree without poses, factorised by QR or CHOLESKY."""
    import gtsam

    settings = gtsam.ISAM2Params()
    settings.setFactorization(factorization)
    settings.setRelinearizeThreshold(relinearize_threshold)
    settings.relinearizeSkip = relinearize_every
    return gtsam.ISAM2(settings)


def refined(
    graph: PoseGraph,
    start: Floats,
    solved: Solved,
    weigh: Callable[[Floats], Floats],
    equations: PoseEquations | None = None,
) -> Optimized:
    """The last Gauss-Newton steps, and the result; `weigh` turns chi2 of the edges (E,) into their weights (E,).

    Where they fail, GTSAM's optimum is kept, with a warning.
    """
    poses, warnings, steps = poses_of(solved.values, graph.planar), list(solved.warnings), 0
    try:
        poses, steps, *_ = gauss_newton(graph, poses, weigh, MAX_STEPS, TOLERANCE, equations=equations)
    except FAILURES as error:  # say, all that ties a pose was rejected
        warnings.append(f"the last steps failed ({brief(error)}); GTSAM's optimum is kept")
    iterations = solved.iterations + steps
    edge_errors = edge_chi2(graph, poses)
    after, weights = float(edge_errors.sum()), weigh(edge_errors)
    return Optimized(poses, chi2(graph, start), after, iterations, weights, warnings=warnings)


def with_covariances(found: Optimized, factors: Any) -> Optimized:
    """An optimum with the marginal covariances of its poses, or one more warning where there are none."""
    warnings = list(found.warnings)
    covariances = covariances_of(factors, found.poses, warnings)
    return replace(found, covariances=covariances, warnings=warnings)


def with_trust(found: Optimized, loops: Any, why: str | None) -> Optimized:
    """An optimum with which of its edges were known inliers, and a sentence of that where others could be rejected.

    `loops` (E,) are the loop closures; `why` says when one is rejected, None: no edge can be.
    """
    if why is None:
        return replace(found, trusted=np.ones(len(loops), bool))
    total, known = int(loops.sum()), int((~loops).sum())
    trust = f"the {known} between consecutive ids of one robot are odometry and trusted"
    if known == 0:
        trust = "no edge joins consecutive ids of one robot, so none is trusted as odometry"
    sentence = f"{int(found.rejected.sum())} of {total} loop closures are rejected ({why}); {trust}"
    return replace(found, trusted=~loops, notes=[*found.notes, sentence])


def covariances_of(factors: Any, poses: Floats, warnings: list[str]) -> Floats | None:
    """Marginal covariances (N, d, d) of poses (N, k); None, and one more of the warnings, where there are none."""
    try:
        return marginals(factors, values_of(poses), poses.shape[1] == 3)
    except FAILURES as error:
        warnings.append(f"there are no covariances ({brief(error)})")
        return None


def check_start(graph: PoseGraph, start: Floats) -> None:
    """DataError where numbers are so large that no solver could start."""
    with np.errstate(over="ignore", invalid="ignore"):
        value = chi2(graph, start)
    if not np.isfinite(value):
        raise DataError(f"chi2 of the first poses is {value}; give motions and information of a usual size")


def is_singular(error: Exception) -> bool:
    """Whether a solver failed because its linear equations have no unique solution to rounding."""
    return any(word in str(error) for word in ("Indeterminate", "singular"))


def brief(error: Exception) -> str:
    """What went wrong, on one line."""
    return "its linear equations are singular" if is_singular(error) else " ".join(str(error).split())[:200]
