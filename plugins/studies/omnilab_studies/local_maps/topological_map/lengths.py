"""Lengths of a map's springs, from image distances: as they are, up to a threshold, or along links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.errors import DataError


@dataclass(frozen=True)
class Lengths:
    """How image distances become lengths: all of them, those up to `threshold`, or the shortest paths along `links`.

    A `conformal` one measures on each image's own scale first.
    """

    links: int = 0  # most alike images of each that it is linked to; 0: no paths
    threshold: float = 0.0  # in units of the least one that leaves the images in one part; 0: none
    conformal: bool = False

    @property
    def name(self) -> str:
        """As part of a metric's name."""
        if self.threshold:
            return f"threshold_{self.threshold:g}"
        return f"conformal_{self.links}" if self.conformal else str(self.links or "all")

    @property
    def title(self) -> str:
        """For figures."""
        if self.threshold:
            return f"threshold {self.threshold:g}"
        return f"{self.links} links{', conformal' * self.conformal}" if self.links else "all distances"

    @property
    def are_distances(self) -> bool:
        """Whether the lengths that count are image distances, with their unit."""
        return self.links == 0

    def of(self, distances: Sequence[Floats]) -> Floats:
        """Lengths (n, n) from one or more methods' image distances, each (n, n); infinite where no spring is.

        DataError if they leave the images in several parts.
        """
        if self.conformal:
            return geodesic(sum_of_scaled(distances, self.links), self.links)
        (distance,) = distances
        if self.threshold:
            return up_to_threshold(distance, self.threshold)
        return geodesic(distance, self.links) if self.links else distance


def up_to_threshold(length: Floats, threshold: float) -> Floats:
    """Lengths (n, n), infinite beyond a threshold (Payá et al., 2016, 3.2.1), which is given in units of the least that connects.

    That one is the longest edge of the minimum spanning tree. DataError, with the number of parts, if it is less.
    """
    most = threshold * connecting_threshold(length)
    kept = np.where(length <= most, length, np.inf)
    _check_one_part(np.isfinite(kept), f"a threshold of {threshold:g} leaves", "1 or more in study.thresholds")
    return kept


def connecting_threshold(length: Floats) -> float:
    """The least threshold of lengths (n, n) at which every point is reached from every other."""
    reached = length[0].copy()  # from the points of the tree (Prim, 1957)
    outside = np.ones(len(length), bool)
    outside[0] = False
    longest = 0.0
    while outside.any():
        nearest = int(np.where(outside, reached, np.inf).argmin())
        longest = max(longest, float(reached[nearest]))
        outside[nearest] = False
        reached = np.minimum(reached, length[nearest])
    return longest


def sum_of_scaled(distances: Sequence[Floats], links: int) -> Floats:
    """The mean of several methods' distances (n, n), each of which is measured on the scale of its two images.

    C-Isomap (de Silva and Tenenbaum, 2003): d_ij / sqrt(m_i m_j), m_i being the mean distance of image i to its `links`
    most alike ones. Where images change faster, as beside furniture, the map is not wider, if they are taken evenly. Being
    free of scale, distances of several methods can be averaged: what looks alike to one of them seldom does to all.
    """
    scaled = []
    for length in distances:
        others = np.sort(np.where(np.eye(len(length), dtype=bool), np.inf, length), axis=1)
        own = others[:, : min(links, len(length) - 1)].mean(axis=1)
        scale = np.sqrt(own[:, None] * own)
        scaled.append(np.divide(length, scale, out=np.zeros_like(length), where=scale > 0))
    return np.mean(scaled, axis=0)  # type: ignore[no-any-return]


def geodesic(length: Floats, links: int) -> Floats:
    """Geodesic distances (n, n): shortest paths along each point's links to its `links` nearest (Isomap: Tenenbaum et al., 2000).

    DataError, with the number of parts, if the links leave the points in several ones.
    """
    others = np.where(np.eye(len(length), dtype=bool), np.inf, length)
    farthest = np.sort(others, axis=1)[:, min(links, len(length) - 1) - 1]
    linked = (others <= farthest[:, None]) | (others <= farthest)
    _check_one_part(linked, "so few links leave", "more in study.links or study.conformal")
    paths = np.where(linked, length, np.inf)
    np.fill_diagonal(paths, 0)
    for k in range(len(length)):  # Floyd and Warshall
        np.minimum(paths, paths[:, k, None] + paths[k], out=paths)
    return paths


def _check_one_part(linked: Bools, what: str, remedy: str) -> None:
    from scipy.sparse.csgraph import connected_components

    count, part = connected_components(linked, directed=False)
    if count > 1:
        raise DataError(
            f"{what} the {len(linked)} images in {count} parts, the largest of {np.bincount(part).max()}; give {remedy}"
        )


def slope_of(distance: Floats, position_m: Floats, reach_m: float) -> float:
    """Image distance per metre: least squares through (0, 0) over the pairs (n, n) at most `reach_m` apart.

    The slope of the paper's figures 7-11, its c (eq. 14). DataError if no two images are so near, or all are alike.
    """
    apart_m = np.linalg.norm(position_m[:, None] - position_m, axis=-1)
    near = (apart_m > 0) & (apart_m <= reach_m)
    if not near.any():
        raise DataError(f"no two images are within study.slope_m={reach_m:g} of one another; give at least the step")
    slope = float(apart_m[near] @ distance[near] / (apart_m[near] @ apart_m[near]))
    if not slope > 0:
        raise DataError("all images are alike, so that their distances have no slope; leave study.slope_m out")
    return slope
