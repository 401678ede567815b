"""Gauss-Newton without damping, from several starts of one graph: what most graphs need, and a third of the time of Levenberg-Marquardt."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.posegraph.graph import chi2
from omnilab_slam.least_squares.equations import PoseEquations
from omnilab_slam.least_squares.gauss_newton import gauss_newton

TOLERANCE = 1e-12  # relative decrease of chi2 that ends it: the last steps keep their equations and cost little
MAX_STEPS = 20
FEW_STEPS = 4  # from a start that is near
FAILURES = (RuntimeError, ValueError)  # the equations are singular


class Descent:
    """chi2 of a graph, step by step downwards."""

    def __init__(self, graph: PoseGraph, max_steps: int) -> None:
        self._graph, self._max_steps = graph, min(max_steps, MAX_STEPS)
        self.equations = PoseEquations(graph.edges, len(graph))

    def optimum(self, start: Floats, max_damping: float = 0) -> Optimized | None:
        """The optimum from poses (N, k), or None where a step does not lead down, damped or not, or steps are too many."""
        try:
            found = gauss_newton(
                self._graph,
                start,
                np.ones_like,
                self._max_steps,
                TOLERANCE,
                equations=self.equations,
                max_damping=max_damping,
            )
        except FAILURES:
            return None
        if not found.converged:
            return None
        one = np.ones(len(found.edge_chi2))
        return Optimized(found.poses, chi2(self._graph, start), float(found.edge_chi2.sum()), found.steps, one)

    def leads_to(self, start: Floats, reached: float, slack: float) -> bool:
        """Whether a few steps from poses (N, k) come to the chi2 `reached`, which another start led to, within a relative slack."""
        enough = (1 + slack) * reached
        try:
            found = gauss_newton(self._graph, start, np.ones_like, FEW_STEPS, TOLERANCE, enough, self.equations)
        except FAILURES:
            return False
        return bool(abs(found.edge_chi2.sum() - reached) <= slack * reached)
