"""Graduated non-convexity (GNC): rejection of wrong loop closures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.errors import ConfigError
from omnilab.posegraph.graph import check_graph, edge_chi2, is_loop
from omnilab_slam.batch import Start, initial_poses
from omnilab_slam.factors import check_at_least, factors_of, noise_of, poses_of, values_of
from omnilab_slam.solvers import check_start, guarded, parameters, refined


@dataclass
class GtsamGnc:
    """Graduated non-convexity with truncated least squares (Yang et al., 2020): each loop closure is kept or rejected.

    Edges from a pose to the next are trusted. A loop closure is rejected where its chi2 is beyond what `probability` of
    sound ones have. GTSAM does not report how many rounds it took: iterations count the last Gauss-Newton steps alone.
    """

    start: Start = Start.given  # given, odometry or lago
    probability: float = 0.99  # of sound loop closures to be kept
    max_iterations: int = 100  # of Levenberg-Marquardt within each round
    tolerance: float = 1e-5  # relative decrease of the error at which a round stops

    def __post_init__(self) -> None:
        if not 0 < self.probability < 1:
            raise ConfigError(f"backend.probability={self.probability} is none; give a number between 0 and 1")
        check_at_least("max_iterations", self.max_iterations, 1)
        check_at_least("tolerance", self.tolerance, 0)

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """GNC until every loop closure is kept or rejected, then the last Gauss-Newton steps."""
        import gtsam

        check_graph(graph)
        start = initial_poses(graph, self.start)
        check_start(graph, start)
        factors, values = factors_of(graph, [noise_of(W) for W in graph.information]), values_of(start)
        weights = np.ones(len(graph.edges))

        def solve() -> tuple[Any, int]:
            solver = gtsam.GncLMOptimizer(factors, values, self._settings(graph))
            solver.setInlierCostThresholdsAtProbability(self.probability)
            optimum = solver.optimize()
            weights[:] = solver.getWeights()[: len(weights)]
            return optimum, 0

        def weigh(_: Floats) -> Floats:
            return weights

        def cost(values: Any) -> float:
            return float(weights @ edge_chi2(graph, poses_of(values, graph.planar)))

        solved = guarded(values, solve, cost)
        return refined(graph, start, solved, weigh, factors if covariances else None)

    def _settings(self, graph: PoseGraph) -> Any:
        import gtsam

        settings = gtsam.GncLMParams(parameters(self.max_iterations, self.tolerance))
        settings.setLossType(gtsam.GncLossType.TLS)
        settings.setKnownInliers([*np.flatnonzero(~is_loop(graph)).tolist(), len(graph.edges)])  # the last: the anchor
        return settings
