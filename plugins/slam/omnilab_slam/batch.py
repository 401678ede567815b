"""Batch Levenberg-Marquardt."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Floats, Optimized, PoseGraph, check_settings, setting
from omnilab.posegraph.graph import check_graph, edge_chi2, is_loop
from omnilab_slam.factors import factors_of, noises_of, robust, values_of
from omnilab_slam.gauss_newton import PoseEquations
from omnilab_slam.kernels import REDESCENDING, Kernel, costs, weights, why
from omnilab_slam.solvers import levenberg_marquardt, refined, with_covariances, with_trust
from omnilab_slam.starts import Start, from_start


@dataclass
class GtsamBatch:
    """Batch Levenberg-Marquardt over the whole graph (GTSAM; Dellaert and Kaess, 2006), then Gauss-Newton on g2o's error.

    A robust `kernel` lowers the weight of loop closures that do not fit; edges from a pose to the next are trusted.
    Redescending kernels (geman_mcclure, welsch, tukey, dcs) would never leave a bad start: they start from Cauchy's optimum.
    """

    start: Start = Start.best  # best, given, odometry, lago or chordal
    kernel: Kernel = Kernel.none  # none, huber, cauchy, geman_mcclure, welsch, tukey or dcs
    kernel_width: float | None = setting(None, above=0)  # in standard deviations; null: the kernel's usual one
    max_iterations: int = setting(200, at_least=1)  # of each solution
    tolerance: float = setting(1e-5, at_least=0)  # relative decrease of the error at which it stops

    def __post_init__(self) -> None:
        check_settings(self, "backend.")

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """Initial guess, Levenberg-Marquardt (twice with a redescending kernel), the last Gauss-Newton steps."""
        check_graph(graph)
        noises, loops = noises_of(graph.information), is_loop(graph)
        kernels = [Kernel.cauchy, self.kernel] if self.kernel in REDESCENDING else [self.kernel]
        widths = [self.kernel_width if kernel is self.kernel else None for kernel in kernels]
        stages = [
            factors_of(graph, robust(noises, loops, kernel, width))
            for kernel, width in zip(kernels, widths, strict=True)
        ]

        equations = PoseEquations(graph.edges, len(graph))

        def weigh(edge_errors: Floats) -> Floats:
            return weights(self.kernel, self.kernel_width, loops, edge_errors)

        def optimize(start: Floats) -> Optimized:
            values, iterations, warnings = values_of(start), 0, list[str]()
            for factors in stages:
                solved = levenberg_marquardt(factors, values, self.max_iterations, self.tolerance)
                values, iterations, warnings = solved.values, iterations + solved.iterations, warnings + solved.warnings
            return refined(graph, start, solved._replace(iterations=iterations, warnings=warnings), weigh, equations)

        def cost(poses: Floats) -> float:
            return float(costs(self.kernel, self.kernel_width, loops, edge_chi2(graph, poses)).sum())

        of_chi2 = equations if self.kernel is Kernel.none else None
        found = from_start(graph, self.start, optimize, cost, equations=of_chi2)
        found = with_trust(found, loops, why(self.kernel))
        return with_covariances(found, stages[-1]) if covariances else found
