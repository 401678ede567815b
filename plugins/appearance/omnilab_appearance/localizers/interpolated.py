"""Interpolation of the position between places by kriging."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Ints, Places, Signatures, check_settings, setting
from omnilab_appearance.localizers.nearest import Nearest, check_map

NOISE = 1e-6  # eigenvalues below this share of the largest are rounding


class KrigingIndex(NamedTuple):
    """A map prepared for interpolation."""

    nearest: tuple[Places, Distance, Any]
    position_m: Floats  # (P, 3)
    around: Ints  # (P, k) the k places nearest to each


@dataclass
class Interpolated:
    """The nearest place, and a position from the distances to its neighbours by ordinary kriging (Matheron, 1963).

    With D the image distances between the `neighbours` places around the nearest place (which is one of them; 9 are the
    3 x 3 block of a grid) and d the query's distances to them, the weights w that sum to 1 and solve D w + m 1 = d make
    the position sum w x. For distances that are squared lengths in some space, as 1 - correlation is, that is the point
    of the neighbours' affine hull nearest to the query. Any distance and any layout of places will do.

    The position never lies farther from the nearest place than the farthest neighbour does; where the nearest place is
    wrong, so is the position. Where all distances are equal it is the neighbours' centroid, among places at one position
    that position. The answered place, its distance and the heading are those of `nearest`.
    """

    neighbours: int = setting(
        9, at_least=2, at_most=10_000
    )  # places interpolated between; all, where the map has fewer

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> KrigingIndex:
        """The map prepared for `nearest`, and the neighbours of each place."""
        from scipy.spatial import KDTree

        check_map(places, "interpolated")
        assert places.T_world_camera is not None
        position_m = places.T_world_camera[:, :3, 3]
        k = min(self.neighbours, len(places))
        _, around = KDTree(position_m).query(position_m, np.arange(1, k + 1))
        return KrigingIndex(Nearest().prepare(places, distance), position_m, np.asarray(around))

    def locate(self, queries: Signatures, index: KrigingIndex) -> Estimates:
        """The nearest places, and positions between their neighbours."""
        estimates = Nearest().locate(queries, index.nearest)
        position_m = np.empty((len(queries), 3))
        for q, place in enumerate(estimates.place):
            around = index.around[place]
            weights = _weights(queries.place[q], around, index)
            position_m[q] = _mix(weights, index.position_m[place], index.position_m[around])
        return replace(estimates, position_m=position_m)


def _weights(query: Floats, around: Ints, index: KrigingIndex) -> Floats:
    """Kriging weights (k,) of the k places around, for a query."""
    places, distance, _ = index.nearest
    some = places.signatures.place[around]
    match = distance.match(Signatures(np.concatenate([some, query[None]])), distance.prepare(Signatures(some)))
    *between, to = match.distance.astype(float)  # among the places, and from the query
    system = np.ones((len(around) + 1, len(around) + 1))
    system[:-1, :-1] = np.add(between, np.transpose(between)) / 2
    np.fill_diagonal(system, 0)
    unit = system[:-1, :-1].max() or 1.0
    system[:-1, :-1] /= unit
    solved = np.linalg.pinv(system, rcond=NOISE, hermitian=True) @ np.append(to / unit, 1)
    return np.asarray(solved[:-1])


def _mix(weights: Floats, center_m: Floats, around_m: Floats) -> Floats:
    """The weighted mean (3,) of positions (k, 3), no farther from `center_m` than the farthest of them."""
    steps = around_m - center_m
    move = weights @ steps
    reach, length = np.linalg.norm(steps, axis=1).max(), np.linalg.norm(move)
    return np.asarray(center_m + (move if length <= reach else move * reach / length))
