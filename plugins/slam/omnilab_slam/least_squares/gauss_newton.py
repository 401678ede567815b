"""Gauss-Newton on the error that `omnilab.posegraph.graph.residuals` measures, as g2o has it.

GTSAM minimises the logarithm of an edge's error. Where loop closures are off by many degrees, the optimum of the other
is elsewhere: on Manhattan's 3500 poses its chi2 is 10 % lower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab_slam.least_squares.equations import Factor, PoseEquations
from omnilab_slam.least_squares.linearization import Linearization, linearized

MAX_DAMPING = 1e6
NOTHING = 1e-12  # chi2 an edge: a millionth of a standard deviation, where all edges can be met
ROUNDING = 1e-9  # relative decrease of chi2 that numbers may hide
CONTRACTION = (
    0.1  # of what a step promises, from the one before: at most so much, and the equations are not factorised again
)


class GaussNewtonResult(NamedTuple):
    """Where Gauss-Newton ended."""

    poses: Floats  # (N, k)
    steps: int
    edge_chi2: Floats  # (E,) there
    converged: bool  # the last step changed nothing to speak of, or came to what was enough


class Step(NamedTuple):
    """Where a step leads, and by how much the equations promise to lower the cost."""

    poses: Floats  # (N, k)
    promise: float
    factor: Factor


def gauss_newton(
    graph: PoseGraph, poses: Floats, weigh: Callable[[Floats], Floats], max_steps: int, tolerance: float,
    enough: float = -np.inf, equations: PoseEquations | None = None, max_damping: float = MAX_DAMPING,
) -> GaussNewtonResult:  # fmt: skip
    """Damped Gauss-Newton from poses (N, k), the first of which stays; `weigh` turns chi2 of the edges (E,) into weights (E,).

    Steps are damped until they lower the weighted sum (Levenberg, 1944), and end where that falls by less than
    `tolerance` of itself, or once it is at most `enough`. While they converge fast and weights stay, they keep the equations that were
    factorised last (chord method). `equations` may come from another solution of the same graph.
    With `max_damping` 0 the first step that lowers nothing ends it.
    """
    equations, here = equations or PoseEquations(graph.edges, len(graph)), linearized(graph, poses)
    weights = weigh(here.chi2)
    cost, damping, steps, promise, converged = float(weights @ here.chi2), 0.0, 0, np.inf, False
    factor: Factor | None = None
    while steps < max_steps and damping <= max_damping and not converged:
        steps += 1
        slight = max(tolerance * cost, NOTHING * len(weights))
        step = _step(equations, here, weights, damping, factor, max(CONTRACTION * promise, slight))
        there = linearized(graph, step.poses)
        gain, kept, factor = cost - float(weights @ there.chi2), step.factor is factor, step.factor
        if not gain > 0:
            converged = step.promise <= max(slight, ROUNDING * cost)
            damping, factor = damping if kept else max(10 * damping, 1e-4), None
            continue
        poses, here, promise = step.poses, there, step.promise
        converged = gain <= slight or cost - gain <= enough
        if damping > 0:
            damping, factor = damping / 10 if damping > 1e-4 else 0.0, None
        before, weights = weights, weigh(here.chi2)
        factor = factor if np.array_equal(before, weights) else None
        cost = float(weights @ here.chi2)
    return GaussNewtonResult(poses, steps, here.chi2, converged)


def _step(
    equations: PoseEquations, here: Linearization, weights: Floats, damping: float, factor: Factor | None, most: float
) -> Step:
    """The next step: by a factor that is there if it promises at most so much, else by one of the equations here."""
    right = -equations.right(here.gradient(weights)[..., None])
    if factor is not None:
        x = factor.solve(right)
        if (promise := float((right[1:] * x).sum())) <= most:
            return Step(here.moved(x[..., 0]), promise, factor)
    factor = equations.factor(here.hessian(weights), damping)
    x = factor.solve(right)
    return Step(here.moved(x[..., 0]), float((right[1:] * x).sum()), factor)
