"""GTSAM's solvers with a net: what fails is said, and the poses they started from are kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.graph import chi2, edge_chi2
from omnilab_slam.factors import marginals, poses_of, values_of
from omnilab_slam.gauss_newton import polish

FAILURES = (RuntimeError, ValueError, IndexError)  # what GTSAM raises
MOST_STEPS = 20  # of polishing
FLATNESS = 1e-6  # relative decrease of chi2 that ends it: steps converge quadratically


class Solved(NamedTuple):
    """Where a solver ended."""

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
    """What `solve` finds (values and iterations), unless it fails or costs more than its start does then."""
    try:
        found, iterations = solve()
    except FAILURES as error:
        return Solved(start, 0, [f"the solver failed ({brief(error)}); the poses it started from are kept"])
    before, after = cost(start), cost(found)
    if after <= before:
        return Solved(found, iterations, [])
    sentence = f"the solver diverged (error {before:.4g}, then {after:.4g}); the poses it started from are kept"
    return Solved(start, iterations, [sentence])


def levenberg_marquardt(factors: Any, start: Any, max_iterations: int, tolerance: float) -> Solved:
    """The optimum nearby."""
    import gtsam

    def solve() -> tuple[Any, int]:
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters(max_iterations, tolerance))
        return optimizer.optimize(), optimizer.iterations()

    solved = guarded(start, solve, factors.error)
    if solved.iterations >= max_iterations:
        solved.warnings.append(f"the solver stopped after max_iterations={max_iterations}; give more")
    return solved


def answer(
    graph: PoseGraph,
    start: Floats,
    solved: Solved,
    weigh: Callable[[Floats], Floats],
    factors: Any | None = None,  # for covariances
) -> Optimized:
    """Polish what was solved, and report; `weigh` turns chi2 of the edges (E,) into their weights (E,)."""
    poses, said, steps = poses_of(solved.values, graph.planar), list(solved.warnings), 0
    try:
        poses, steps = polish(graph, poses, weigh, MOST_STEPS, FLATNESS)
    except FAILURES as error:  # say, all that ties a pose was rejected
        said.append(f"the last steps failed ({brief(error)}); GTSAM's optimum is kept")
    spread = None if factors is None else covariances_of(factors, poses, said)
    iterations = solved.iterations + steps
    weights = weigh(edge_chi2(graph, poses))
    return Optimized(poses, chi2(graph, start), chi2(graph, poses), iterations, weights, spread, said)


def covariances_of(factors: Any, poses: Floats, said: list[str]) -> Floats | None:
    """Covariances (N, d, d) of poses (N, k); where there are none, that is added to what is said."""
    try:
        return marginals(factors, values_of(poses), poses.shape[1] == 3)
    except FAILURES as error:
        said.append(f"there are no covariances ({brief(error)})")
        return None


def check_start(graph: PoseGraph, start: Floats) -> None:
    """DataError where numbers are so large that no solver could start."""
    with np.errstate(over="ignore", invalid="ignore"):
        value = chi2(graph, start)
    if not np.isfinite(value):
        raise DataError(f"chi2 of the first poses is {value}; give motions and information of a usual size")


def brief(error: Exception) -> str:
    """An error's text on one line."""
    return " ".join(str(error).split())[:200]
