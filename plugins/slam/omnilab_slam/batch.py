"""Batch least squares: Gauss-Newton and Levenberg-Marquardt."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from omnilab.api import Bools, Floats, Optimized, PoseGraph, check_settings, setting
from omnilab.posegraph.graph import check_graph, edge_chi2, is_loop
from omnilab_slam.factors import factors_of, noises_of, robust, values_of
from omnilab_slam.kernels import REDESCENDING, Kernel, costs, weights, why
from omnilab_slam.least_squares.descent import Descent
from omnilab_slam.least_squares.equations import PoseEquations
from omnilab_slam.solvers import levenberg_marquardt, refined, with_covariances, with_trust
from omnilab_slam.starts import Start, from_start


@dataclass
class GtsamBatch:
    """Least squares over the whole graph: Gauss-Newton on g2o's error, and where its steps do not lead straight down, or with a robust kernel,
    batch Levenberg-Marquardt (GTSAM; Dellaert and Kaess, 2006) first.

    A robust `kernel` lowers the weight of loop closures that do not fit; edges from a pose to the next are trusted.
    Redescending kernels (geman_mcclure, welsch, tukey, dcs) would never leave a bad start: they start from Cauchy's optimum.
    """

    start: Start = Start.best  # best, given, odometry, lago or chordal
    kernel: Kernel = Kernel.none  # none, huber, cauchy, geman_mcclure, welsch, tukey or dcs
    kernel_width: float | None = setting(None, above=0)  # in standard deviations; null: the kernel's usual one
    max_iterations: int = setting(200, at_least=1)  # of each solution
    tolerance: float = setting(1e-5, at_least=0)  # relative decrease of the error at which Levenberg-Marquardt stops

    def __post_init__(self) -> None:
        check_settings(self, "backend.")

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """From one start or several; each by Gauss-Newton, or by Levenberg-Marquardt and the last Gauss-Newton steps."""
        check_graph(graph)
        loops = is_loop(graph)
        descent = Descent(graph, self.max_iterations)

        @cache
        def stages() -> list[Any]:
            return self._stages(graph, loops)

        def optimize(start: Floats) -> Optimized:
            return self._levenberg_marquardt(graph, loops, stages(), start, descent.equations)

        def cost(poses: Floats) -> float:
            return float(costs(self.kernel, self.kernel_width, loops, edge_chi2(graph, poses)).sum())

        found = from_start(graph, self.start, optimize, cost, descent=descent if self.kernel is Kernel.none else None)
        found = with_trust(found, loops, why(self.kernel))
        return with_covariances(found, stages()[-1]) if covariances else found

    def _stages(self, graph: PoseGraph, loops: Bools) -> list[Any]:
        """The factor graphs that are solved one after the other: two with a redescending kernel."""
        noises = noises_of(graph.information)
        if self.kernel not in REDESCENDING:
            return [factors_of(graph, robust(noises, loops, self.kernel, self.kernel_width))]
        first = factors_of(graph, robust(noises, loops, Kernel.cauchy, None))
        return [first, factors_of(graph, robust(noises, loops, self.kernel, self.kernel_width))]

    def _levenberg_marquardt(
        self, graph: PoseGraph, loops: Bools, stages: list[Any], start: Floats, equations: PoseEquations
    ) -> Optimized:
        """Levenberg-Marquardt on each of the factor graphs, then the last Gauss-Newton steps."""

        def weigh(edge_errors: Floats) -> Floats:
            return weights(self.kernel, self.kernel_width, loops, edge_errors)

        values, iterations, warnings = values_of(start), 0, list[str]()
        for factors in stages:
            solved = levenberg_marquardt(factors, values, self.max_iterations, self.tolerance)
            values, iterations, warnings = solved.values, iterations + solved.iterations, warnings + solved.warnings
        return refined(graph, start, solved._replace(iterations=iterations, warnings=warnings), weigh, equations)
