"""Initial guesses of the poses of a graph, and the best of several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import Enum

import numpy as np

from omnilab.api import Floats, Optimized, PoseGraph
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.graph import chi2, chi2_quantile, dead_reckoning
from omnilab_slam.factors import factors_of, poses_of
from omnilab_slam.least_squares.chordal import chordal
from omnilab_slam.least_squares.descent import Descent
from omnilab_slam.least_squares.equations import PoseEquations
from omnilab_slam.least_squares.gauss_newton import MAX_DAMPING, gauss_newton
from omnilab_slam.solvers import FAILURES, MAX_STEPS, TOLERANCE, brief, check_start

FAR_BELOW = 0.05  # relative difference of chi2 that is more than an incremental solver's last steps
SAME_OPTIMUM = 1e-4  # relative difference of costs below which two starts led to one optimum: solvers stop before that
ALL_FOLLOWED = 3000  # poses up to which each start is followed, however far off: half a second
EXPLAINED = 0.99  # of graphs with sound edges have a lower chi2 than what is taken to be noise


class Start(Enum):
    """Initial guess of the poses."""

    best = "best"  # given and chordal: the one that ends at the lower cost; given where they end alike
    given = "given"  # the graph's own; where a file has none, those of odometry
    odometry = "odometry"  # motions chained from the first pose
    lago = "lago"  # headings first, by a linear problem (Carlone et al., 2014); planar graphs
    chordal = "chordal"  # rotations first, by a linear problem (Carlone et al., 2015)


def from_start(
    graph: PoseGraph,
    start: Start,
    optimize: Callable[[Floats], Optimized],
    cost: Callable[[Floats], float],
    far: float = np.inf,
    descent: Descent | None = None,
) -> Optimized:
    """The optimum from a start, or from the best of several: the one with the lowest cost.

    `optimize` takes the poses (N, k) to start from, `cost` tells what is minimised at poses (N, k). chi2_before is that of
    the start, of several that of the given one. A chordal start of more than `far` times the cost that the given one led
    to is not followed. Where the cost is chi2, give a `descent`: what it solves is not left to `optimize`.
    """

    def followed(poses: Floats) -> Optimized:
        return (descent and descent.optimum(poses)) or optimize(poses)

    if start is not Start.best:
        poses = initial_poses(graph, start)
        check_start(graph, poses)
        return followed(poses)
    check_start(graph, graph.poses)
    given = descent.optimum(graph.poses) if descent else optimize(graph.poses)
    other = _chordal_start(graph, descent.equations if descent else None)
    if other is None:
        return given or optimize(graph.poses)
    found = None
    if descent and given is None:
        found = descent.optimum(other, MAX_DAMPING)
        if found and len(graph) > ALL_FOLLOWED and _is_noise(graph, found.chi2):
            return _without_the_given(graph, found)
    given = given or optimize(graph.poses)
    reached = cost(given.poses)
    if cost(other) > far * max(reached, len(graph.edges)):  # chi2 of noise alone is about one for each edge
        return given
    if descent and not found and descent.leads_to(other, reached, SAME_OPTIMUM):
        return replace(given, starts={Start.given.value: reached, Start.chordal.value: reached})
    found = found or followed(other)
    return _better(given, found, {Start.given.value: reached, Start.chordal.value: cost(found.poses)})


def _chordal_start(graph: PoseGraph, equations: PoseEquations | None = None) -> Floats | None:
    """The chordal poses (N, k); None where there are none of finite chi2, and for a tree, in which no motion contradicts another."""
    if len(graph.edges) < len(graph):
        return None
    try:
        poses = chordal(graph, equations)
    except FAILURES:  # the linear problem is singular to rounding
        return None
    return poses if np.isfinite(poses).all() and np.isfinite(chi2(graph, poses)) else None


def _is_noise(graph: PoseGraph, least: float) -> bool:
    """Whether the information of the edges explains a chi2, so that no other optimum could be told to be better."""
    freedom = graph.information.shape[1] * (len(graph.edges) - len(graph) + 1)
    return least <= chi2_quantile(freedom, EXPLAINED)


def _without_the_given(graph: PoseGraph, found: Optimized) -> Optimized:
    """The optimum of the chordal start where the given one is too far off to be worth following."""
    sentence = (
        f"start=given is so far off that Gauss-Newton's steps from it do not lead down; start=chordal leads to {found.chi2:.6g},"
        " which noise explains, and is kept; backend.start=given follows the other"
    )
    return replace(
        found, chi2_before=chi2(graph), starts={Start.chordal.value: found.chi2}, notes=[sentence, *found.notes]
    )


def _better(given: Optimized, found: Optimized, costs: dict[str, float]) -> Optimized:
    """The optimum of the lower cost, the given start's where they are alike; with what each start led to."""
    (own, before), (other, after) = costs.items()
    if abs(before - after) <= SAME_OPTIMUM * max(before, after):
        return replace(given, starts={own: before, other: before})
    if before < after:
        return replace(given, starts={own: before, other: after})
    sentence = (
        f"start={own} ends in a local minimum (cost {before:.6g}); start={other} leads to {after:.6g} and is kept"
    )
    return replace(
        found, chi2_before=given.chi2_before, starts={other: after, own: before}, notes=[sentence, *found.notes]
    )


def beside_chordal(graph: PoseGraph, found: Optimized) -> Optimized:
    """The optimum of a back end that takes poses as they come, with what Gauss-Newton from a chordal start leads to."""
    start = _chordal_start(graph)
    if start is None:
        return found
    try:
        poses = gauss_newton(graph, start, np.ones_like, MAX_STEPS, TOLERANCE).poses
    except FAILURES:
        return found
    other = chi2(graph, poses)
    if not (np.isfinite(other) and other < (1 - FAR_BELOW) * found.chi2):
        return found
    sentence = f"poses as they come lead to chi2 {found.chi2:.6g}, a chordal start to {other:.6g}; backend=gtsam_batch keeps that"
    starts = {Start.odometry.value: found.chi2, Start.chordal.value: other}
    return replace(found, starts=starts, notes=[*found.notes, sentence])


def initial_poses(graph: PoseGraph, start: Start) -> Floats:
    """The initial guess, poses (N, k); DataError where a linear problem has no solution."""
    if start is Start.given:
        return graph.poses
    if start is Start.odometry:
        return dead_reckoning(graph)
    if start is Start.lago and not graph.planar:
        raise ConfigError("backend.start=lago is for planar graphs, and this one is spatial; give chordal")
    try:
        return _lago(graph) if start is Start.lago else chordal(graph)
    except FAILURES as error:
        raise DataError(f"{start.value} finds no start ({brief(error)}); give backend.start=odometry") from error


def _lago(graph: PoseGraph) -> Floats:
    """LAGO, linear approximation for graph optimisation (Carlone et al., 2014), on a copy with diagonal noise.

    GTSAM's takes no other noise.
    """
    import gtsam

    variances = np.diagonal(np.linalg.inv(graph.information), axis1=1, axis2=2)
    noises = [gtsam.noiseModel.Diagonal.Variances(v) for v in variances]
    return poses_of(gtsam.lago.initialize(factors_of(graph, noises)), planar=True)
