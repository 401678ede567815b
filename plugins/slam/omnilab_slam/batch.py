"""Batch Levenberg-Marquardt."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.graph import check_graph, dead_reckoning, is_loop
from omnilab_slam.factors import check_at_least, factors_of, noise_of, poses_of, robust, values_of
from omnilab_slam.kernels import REDESCENDING, Kernel, check_width, weights
from omnilab_slam.solvers import FAILURES, brief, check_start, levenberg_marquardt, refined


class Start(Enum):
    """Initial guess of the poses."""

    given = "given"  # the graph's own; where a file has none, those of odometry
    odometry = "odometry"  # motions chained from the first pose
    lago = "lago"  # headings first, by a linear problem (Carlone et al., 2014); planar graphs


@dataclass
class GtsamBatch:
    """Batch Levenberg-Marquardt over the whole graph (GTSAM; Dellaert and Kaess, 2006), then Gauss-Newton on g2o's error.

    A robust `kernel` lowers the weight of loop closures that do not fit; edges from a pose to the next are trusted.
    Redescending kernels (geman_mcclure, welsch, tukey, dcs) would never leave a bad start: they start from Cauchy's optimum.
    """

    start: Start = Start.given  # given, odometry or lago
    kernel: Kernel = Kernel.none  # none, huber, cauchy, geman_mcclure, welsch, tukey or dcs
    kernel_width: float | None = None  # in standard deviations; null: the kernel's usual one
    max_iterations: int = 200  # of each solution
    tolerance: float = 1e-5  # relative decrease of the error at which it stops

    def __post_init__(self) -> None:
        check_width(self.kernel_width)
        check_at_least("max_iterations", self.max_iterations, 1)
        check_at_least("tolerance", self.tolerance, 0)

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """Initial guess, Levenberg-Marquardt (twice with a redescending kernel), the last Gauss-Newton steps."""
        check_graph(graph)
        start = initial_poses(graph, self.start)
        check_start(graph, start)
        noises, loops = [noise_of(W) for W in graph.information], is_loop(graph)
        values, iterations, warnings = values_of(start), 0, list[str]()
        for kernel in [Kernel.cauchy, self.kernel] if self.kernel in REDESCENDING else [self.kernel]:
            width = self.kernel_width if kernel is self.kernel else None
            factors = factors_of(graph, robust(noises, loops, kernel, width))
            solved = levenberg_marquardt(factors, values, self.max_iterations, self.tolerance)
            values, iterations, warnings = solved.values, iterations + solved.iterations, warnings + solved.warnings

        def weigh(edge_chi2: Floats) -> Floats:
            return weights(self.kernel, self.kernel_width, loops, edge_chi2)

        solved = solved._replace(iterations=iterations, warnings=warnings)
        return refined(graph, start, solved, weigh, factors if covariances else None)


def initial_poses(graph: PoseGraph, start: Start) -> Floats:
    """The initial guess, poses (N, k)."""
    if start is Start.given:
        return graph.poses
    if start is Start.odometry:
        return dead_reckoning(graph)
    return _lago(graph)


def _lago(graph: PoseGraph) -> Floats:
    """LAGO, linear approximation for graph optimisation (Carlone et al., 2014), on a copy with diagonal noise.

    GTSAM's takes no other noise.
    """
    import gtsam

    if not graph.planar:
        raise ConfigError("backend.start=lago is for planar graphs, and this one is spatial; give given or odometry")
    variances = np.diagonal(np.linalg.inv(graph.information), axis1=1, axis2=2)
    noises = [gtsam.noiseModel.Diagonal.Variances(v) for v in variances]
    try:
        return poses_of(gtsam.lago.initialize(factors_of(graph, noises)), planar=True)
    except FAILURES as error:
        raise DataError(f"lago finds no start ({brief(error)}); give backend.start=odometry") from error
