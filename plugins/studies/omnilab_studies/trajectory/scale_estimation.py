"""Pose graphs in which the lengths of some edges are known but for a factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from omnilab.api import Backend, Floats, Ints, Optimized, PoseGraph
from omnilab.posegraph.graph import between
from omnilab_studies.trajectory.front_end import scaled

MOST = 20  # rounds
CLOSE = 1e-6  # of a factor: then it has settled


def optimize(backend: Backend, graph: PoseGraph, groups: Ints, factors: Floats) -> tuple[Optimized, Floats]:
    """The optimum of a planar graph, and the factors (G,) of the lengths of its groups of edges (E,) from a first guess.

    Edges of group -1 have no factor. Each round moves the poses to where they fit the edges best, and the factors to
    where they fit the poses best; how two such rounds compare tells where that leads to (Aitken, 1926).
    """
    unknown = np.unique(groups[groups >= 0])
    found = backend.optimize(_with(graph, groups, factors))
    if len(unknown) == 0:
        return found, factors
    for _ in range(MOST):
        first = _fitting(graph, found, groups, factors)
        found = backend.optimize(replace(_with(graph, groups, first), poses=found.poses))
        second = _fitting(graph, found, groups, first)
        if np.abs(second - first).max() <= CLOSE * np.abs(first).max():
            break
        bend = second - 2 * first + factors
        ahead = np.divide((first - factors) ** 2, bend, out=factors - second, where=np.abs(bend) > 1e-15)
        leap = factors - ahead
        factors = np.where(leap > 0, leap, second)
        found = backend.optimize(replace(_with(graph, groups, factors), poses=found.poses))
    return found, second


def _with(graph: PoseGraph, groups: Ints, factors: Floats) -> PoseGraph:
    motions, information = scaled(graph.motions, graph.information, groups, factors)
    return replace(graph, motions=motions, information=information)


def _fitting(graph: PoseGraph, found: Optimized, groups: Ints, factors: Floats) -> Floats:
    """The factors (G,) that fit the poses best, edges counting as much as the optimum trusted them."""
    lies = between(found.poses, graph.edges)[:, :2]
    W = graph.information[:, :2, :2] * found.weights[:, None, None]
    own = np.einsum("ei,eij,ej->e", graph.motions[:, :2], W, graph.motions[:, :2])
    both = np.einsum("ei,eij,ej->e", graph.motions[:, :2], W, lies)
    fitting = factors.copy()
    for group in np.unique(groups[groups >= 0]):
        members = groups == group
        if own[members].sum() > 0:
            fitting[group] = both[members].sum() / own[members].sum()
    return fitting
