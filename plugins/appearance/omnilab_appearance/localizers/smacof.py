"""SMACOF: multidimensional scaling by stress majorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Ints, setting
from omnilab_appearance.common.circular_correlation import blas
from omnilab_appearance.localizers.local_maps import LocalMapLocalizer, connected, log, marks_of


@dataclass
class Smacof(LocalMapLocalizer):
    """A local map of least stress, Σ w (|x_i - x_j| - d_ij)², by majorisation from classical scaling (de Leeuw, 1977).

    Guttman transforms with weights (Borg and Groenen, 2005, 8.5-8.6) lower the stress until it falls by less than
    `tolerance`, relative. Distances that do not count have weight 0; classical scaling takes the shortest paths there.
    """

    tolerance: float = setting(1e-6, above=0)  # settled where the stress falls by less than this share
    iterations: int = setting(10_000, at_least=1)  # at most

    def _embed(
        self, lengths: Floats, weights: Floats, rng: np.random.Generator, steps: int
    ) -> tuple[Floats, Ints, Floats | None]:
        """Classical scaling, then Guttman transforms."""
        with blas().limit(limits=1, user_api="blas"):
            start = classical_scaling(complete_distances(lengths, weights > 0), rng).swapaxes(1, 2).copy()
            inverse = _laplacian_inverse(weights)
        no_marks = np.empty((0, len(start)), np.int64)
        position, iterations, _ = self._majorise(lengths, weights, inverse, start, no_marks)
        if (falling := iterations < 0).any():
            log.warning("the stress of %d of %d maps still fell after %d iterations; raise iterations or tolerance",
                        falling.sum(), len(start), self.iterations)  # fmt: skip
        taken = np.where(iterations < 0, self.iterations, iterations)
        states = None
        if steps:
            states = self._majorise(lengths, weights, inverse, start, marks_of(taken, steps))[2].swapaxes(2, 3)
        return position.swapaxes(1, 2), taken, states

    def _majorise(self, lengths: Floats, weights: Floats, inverse: Floats, start: Floats, marks: Ints) -> Any:
        from omnilab_appearance.localizers import map_kernels

        return map_kernels.majorise(lengths, weights, inverse, start, self.tolerance, self.iterations, marks)


def _laplacian_inverse(weights: Floats) -> Floats:
    """The pseudo-inverse (B, n, n) of the weights' Laplacian, which takes constants to zero."""
    n = weights.shape[1]
    first = weights[0, 0, 1]
    if first > 0 and (weights == first * (1 - np.eye(n))).all():
        return np.tile((np.eye(n) - 1 / n) / (n * first), (len(weights), 1, 1))
    laplacian = np.eye(n) * weights.sum(axis=2)[:, None] - weights
    whole = connected(weights > 0)
    inverse = np.empty_like(weights)
    inverse[whole] = np.linalg.inv(laplacian[whole] + 1 / n) - 1 / n
    inverse[~whole] = np.linalg.pinv(laplacian[~whole], hermitian=True)
    return inverse


def classical_scaling(lengths: Floats, rng: np.random.Generator) -> Floats:
    """Points (B, n, 2) from distances (B, n, n): the two widest axes of their double-centred squares (Torgerson, 1952).

    Distances of a line have one axis only, which no Guttman transform leaves: across it the coordinates are drawn,
    a thousandth as wide.
    """
    from scipy.linalg import eigh

    squares = lengths**2
    rows = squares.mean(axis=2, keepdims=True)
    inner = -0.5 * (squares - rows - rows.swapaxes(1, 2) + rows.mean(axis=1, keepdims=True))
    n = lengths.shape[1]
    value, axis = zip(*(eigh(one, subset_by_index=[n - 2, n - 1]) for one in inner), strict=True)
    points = np.stack(axis) * np.sqrt(np.maximum(value, 0))[:, None]
    width = np.abs(points[:, :, 1]).max(axis=1)
    flat = np.abs(points[:, :, 0]).max(axis=1) < 1e-6 * width
    points[flat, :, 0] = 1e-3 * width[flat, None] * rng.standard_normal(n)
    return np.asarray(points)


def complete_distances(lengths: Floats, counts: Bools) -> Floats:
    """Lengths with the shortest path in place of those that do not count, twice the longest where there is none."""
    from scipy.sparse.csgraph import csgraph_from_dense, shortest_path

    full = lengths.copy()
    pairs = lengths.shape[1] * (lengths.shape[1] - 1)
    for b in np.flatnonzero(counts.sum(axis=(1, 2)) < pairs):
        longest = lengths[b].max()
        # images may be repeated: a length of 0 is an edge
        edges = csgraph_from_dense(np.where(counts[b], lengths[b], np.inf), null_value=np.inf)
        paths = shortest_path(edges, directed=False)
        full[b] = np.where(np.isfinite(paths), paths, 2 * longest)
    return full
