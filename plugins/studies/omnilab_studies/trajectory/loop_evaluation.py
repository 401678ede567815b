"""How many loop closures are right, and how many of the places that were seen again were recognised."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.trajectory.evaluation import path_length

APART = 5.0  # a place is seen again after a way of so many times the distance within which it counts as the same


class Judged(NamedTuple):
    """Loop closures and the truth."""

    right: Bools  # (L,) which closures join one place
    again: Bools  # (N,) which images show a place that was shown before
    same_place_m: float

    @property
    def precision(self) -> float:
        """Share of the closures that are right; NaN without any."""
        return float(self.right.mean()) if len(self.right) else float("nan")

    def recall(self, closures: Ints) -> float:
        """Share of the images of places seen before that were recognised, by closures (L, 2); NaN without any."""
        recognised = np.isin(np.flatnonzero(self.again), closures[self.right, 1])
        return float(recognised.mean()) if self.again.any() else float("nan")


def judge(closures: Ints, truth: Floats, same_place_m: float | None) -> Judged:
    """Closures (L, 2) from an earlier to a later of poses (N, 4, 4); two poses within `same_place_m` show one place.

    Two usual steps where that is None.
    """
    at, along = truth[:, :2, 3], path_length(truth)
    near = 2 * float(np.median(np.diff(along))) if same_place_m is None else same_place_m
    right = np.linalg.norm(at[closures[:, 0]] - at[closures[:, 1]], axis=1) <= near
    again = np.zeros(len(at), bool)
    for i in range(len(at)):
        earlier = np.searchsorted(along, along[i] - APART * near)
        again[i] = bool((np.linalg.norm(at[:earlier] - at[i], axis=1) <= near).any())
    return Judged(right, again, near)
