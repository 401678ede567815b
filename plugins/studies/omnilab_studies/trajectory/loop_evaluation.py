"""Loop-closure test: precision and recall of the recognised places (Berenguer, thesis, figure 6.7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.trajectory.evaluation import path_length

REVISIT = 5.0  # a place is revisited after a path of so many times the distance within which it counts as the same


class LoopEvaluation(NamedTuple):
    """L loop closures and N images, judged by the true poses."""

    right: Bools  # (L,) which closures join one place
    revisited: Bools  # (N,) which images show a place that was shown before
    same_place_m: float

    @property
    def precision(self) -> float:
        """Share of the closures that are right; NaN without any, and of a robot that stood still: all would be right."""
        return float(self.right.mean()) if len(self.right) and self.same_place_m > 0 else float("nan")

    def recall(self, closures: Ints) -> float:
        """Share of the images of revisited places that were recognised, by closures (L, 2); NaN without any."""
        recognised = np.isin(np.flatnonzero(self.revisited), closures[self.right, 1])
        return float(recognised.mean()) if self.revisited.any() else float("nan")


def evaluate_loops(closures: Ints, truth: Floats, same_place_m: float | None) -> LoopEvaluation:
    """Loop closures (L, 2), from an earlier to a later of true poses (N, 4, 4), as right or wrong.

    Two poses within `same_place_m`, in metres, show one place; None: within two usual steps.
    """
    position, along = truth[:, :2, 3], path_length(truth)
    near = 2 * float(np.median(np.diff(along))) if same_place_m is None else same_place_m
    right = np.linalg.norm(position[closures[:, 0]] - position[closures[:, 1]], axis=1) <= near
    revisited = np.zeros(len(position), bool)
    for i in range(len(position)):
        earlier = np.searchsorted(along, along[i] - REVISIT * near)
        revisited[i] = bool((np.linalg.norm(position[:earlier] - position[i], axis=1) <= near).any())
    return LoopEvaluation(right, revisited, near)
