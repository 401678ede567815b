"""Graduated non-convexity (GNC): rejection of wrong loop closures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Optimized, PoseGraph, check_settings, setting
from omnilab.posegraph.graph import check_graph, edge_chi2, is_loop
from omnilab_slam.factors import factors_of, noise_of, poses_of, values_of
from omnilab_slam.solvers import guarded, parameters, refined, with_covariances, with_trust
from omnilab_slam.starts import Start, from_start

FAR = 100.0  # a linear problem knows no outliers: from a start that they have torn apart, GNC takes minutes to return


@dataclass
class GtsamGnc:
    """Graduated non-convexity with truncated least squares (Yang et al., 2020): each loop closure is kept or rejected.

    Edges from a pose to the next are trusted. A loop closure is rejected where its chi2 is beyond what `probability` of
    sound ones have. GTSAM does not report how many rounds it took: iterations count the last Gauss-Newton steps alone.
    """

    start: Start = Start.best  # best, given, odometry, lago or chordal
    probability: float = setting(0.99, above=0, below=1)  # of sound loop closures to be kept
    max_iterations: int = setting(100, at_least=1)  # of Levenberg-Marquardt within each round
    tolerance: float = setting(1e-5, at_least=0)  # relative decrease of the error at which a round stops

    def __post_init__(self) -> None:
        check_settings(self, "backend.")

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """GNC until every loop closure is kept or rejected, then the last Gauss-Newton steps."""
        import gtsam

        check_graph(graph)
        loops, factors = is_loop(graph), factors_of(graph, [noise_of(W) for W in graph.information])
        limit = self._limit(graph)

        def optimize(start: Floats) -> Optimized:
            values, weights = values_of(start), np.ones(len(graph.edges))

            def solve() -> tuple[Any, int]:
                solver = gtsam.GncLMOptimizer(factors, values, self._settings(loops))
                solver.setInlierCostThresholdsAtProbability(self.probability)
                optimum = solver.optimize()
                weights[:] = solver.getWeights()[: len(weights)]
                return optimum, 0

            def weighted(values: Any) -> float:
                return float(weights @ edge_chi2(graph, poses_of(values, graph.planar)))

            return refined(graph, start, guarded(values, solve, weighted), lambda _: weights)

        def cost(poses: Floats) -> float:
            errors = edge_chi2(graph, poses)
            return float(np.where(loops, np.minimum(errors, limit), errors).sum())

        found = from_start(graph, self.start, optimize, cost, FAR)
        why = f"chi2 beyond {limit:.4g}, which {100 * (1 - self.probability):.4g} % of sound ones exceed"
        found = with_trust(found, loops, why)
        return with_covariances(found, factors) if covariances else found

    def _limit(self, graph: PoseGraph) -> float:
        """chi2 beyond which a loop closure is rejected: the quantile of `probability` for its degrees of freedom."""
        from scipy.special import gammaincinv

        return float(2 * gammaincinv(graph.information.shape[1] / 2, self.probability))

    def _settings(self, loops: Bools) -> Any:
        import gtsam

        settings = gtsam.GncLMParams(parameters(self.max_iterations, self.tolerance))
        settings.setLossType(gtsam.GncLossType.TLS)
        settings.setKnownInliers([*np.flatnonzero(~loops).tolist(), len(loops)])  # the last: the anchor
        return settings
