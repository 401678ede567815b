"""Scale estimation: pose graphs in which the lengths of some edges are known up to a factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from omnilab.api import Backend, Floats, Ints, Optimized, PoseGraph
from omnilab.posegraph.graph import between
from omnilab_studies.trajectory.front_end import scaled

MAX_ROUNDS = 20
TOLERANCE = 1e-6  # relative change of the factors at which they have converged


def optimize(backend: Backend, graph: PoseGraph, groups: Ints, factors: Floats) -> tuple[Optimized, Floats]:
    """The optimum of a planar graph, and the factors (G,) of the lengths of its groups of edges (E,) from a first guess.

    Edges of group -1 have no factor. Alternating least squares: each round moves the poses to where they fit the edges
    best, and the factors to where they fit the poses best; two such rounds are extrapolated (Aitken, 1926).
    """
    unknown = np.unique(groups[groups >= 0])
    optimized = backend.optimize(_with_factors(graph, groups, factors))
    if len(unknown) == 0:
        return optimized, factors
    for _ in range(MAX_ROUNDS):
        first = _best_factors(graph, optimized, groups, factors)
        optimized = backend.optimize(replace(_with_factors(graph, groups, first), poses=optimized.poses))
        second = _best_factors(graph, optimized, groups, first)
        if np.abs(second - first).max() <= TOLERANCE * np.abs(first).max():
            break
        factors = _extrapolated(factors, first, second)
        optimized = backend.optimize(replace(_with_factors(graph, groups, factors), poses=optimized.poses))
    return optimized, second


def _extrapolated(start: Floats, first: Floats, second: Floats) -> Floats:
    """Aitken's delta-squared extrapolation of three successive factors (G,); the last where it would not be above 0."""
    curvature = second - 2 * first + start
    step = np.divide((first - start) ** 2, curvature, out=start - second, where=np.abs(curvature) > 1e-15)
    limit = start - step
    return np.where(limit > 0, limit, second)


def _with_factors(graph: PoseGraph, groups: Ints, factors: Floats) -> PoseGraph:
    """The graph, the lengths of each group's edges times its factor."""
    motions, information = scaled(graph.motions, graph.information, groups, factors)
    return replace(graph, motions=motions, information=information)


def _best_factors(graph: PoseGraph, optimized: Optimized, groups: Ints, factors: Floats) -> Floats:
    """The factors (G,) that fit the poses best in the least squares, edges with the weights of the optimum."""
    translation = between(optimized.poses, graph.edges)[:, :2]
    W = graph.information[:, :2, :2] * optimized.weights[:, None, None]
    own = np.einsum("ei,eij,ej->e", graph.motions[:, :2], W, graph.motions[:, :2])
    cross = np.einsum("ei,eij,ej->e", graph.motions[:, :2], W, translation)
    best = factors.copy()
    for group in np.unique(groups[groups >= 0]):
        members = groups == group
        if own[members].sum() > 0:
            best[group] = cross[members].sum() / own[members].sum()
    return best
