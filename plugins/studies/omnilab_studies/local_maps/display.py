"""Maps in the viewer: points joined by springs, coloured by strain, as an embedding settles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from omnilab.api import Embedding, Floats, Graph, Ints
from omnilab.geometry import Similarity

REST, STRETCHED, COMPRESSED = np.array([198, 203, 212]), np.array([224, 49, 49]), np.array([40, 110, 230])
SPRINGS = 4  # of each point, to those that are most alike, that are shown
FULL = 0.5  # strain at which a spring has its full colour
STATE_NS = 50_000_000  # between two states of an embedding, in the logs


def springs(position_m: Floats, length_m: Floats, edges: Ints) -> Graph:
    """Points (n, 3) and springs (E, 2) of natural lengths (n, n): stretched ones red, compressed ones blue.

    The colour is full where a spring is half as long again as its natural length, or half as long.
    """
    a, b = edges.T
    natural = length_m[a, b]
    apart = np.linalg.norm(position_m[a] - position_m[b], axis=1)
    strain = np.divide(apart - natural, natural, out=np.ones_like(natural), where=natural > 0)[:, None]
    strain = (strain / FULL).clip(-1, 1)
    colors = REST + np.abs(strain) * (np.where(strain > 0, STRETCHED, COMPRESSED) - REST)
    return Graph(position_m, edges, np.round(colors).astype(np.uint8))


def nearest_edges(length: Floats, count: int) -> Ints:
    """Each point's springs to the `count` points that are most alike (E, 2), each spring once; lengths (n, n)."""
    others = np.where(np.eye(len(length), dtype=bool), np.inf, length)
    near = np.argsort(others, axis=1, kind="stable")[:, : min(count, len(length) - 1)]
    ends = np.stack([np.repeat(np.arange(len(length)), near.shape[1]), near.ravel()], axis=1)
    return np.unique(np.sort(ends, axis=1), axis=0)


def settling(embedding: Embedding, which: int, length: Floats, fit: Similarity, height_m: float) -> Iterator[Graph]:
    """The states of one of the B embedded maps, each moved by the `fit` of the last one to the world; lengths (n, n)."""
    assert embedding.steps is not None
    edges = nearest_edges(length, SPRINGS)
    for plane in embedding.steps[:, which]:
        yield springs(at_height(fit.apply(plane), height_m), float(fit.scale) * length, edges)


def at_height(position_m: Floats, height_m: float) -> Floats:
    """Positions (n, 2) of the plane at a height, (n, 3)."""
    return np.column_stack([position_m, np.full(len(position_m), height_m)])
