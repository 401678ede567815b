"""Repeated observations whose errors are correlated."""

from __future__ import annotations

import math

import numpy as np

from omnilab.api import Floats

METRES_OF_RADIAN = 1.0  # a rotation changes what is in the image about as much
MOST = 0.999  # correlation of two successive observations: at a halt they are not worth nothing


class RepeatedObservations:
    """By how much the covariance of an observation grows where one like it was taken a short way before.

    The errors of a view's angles, or of a landmark's, are alike from pose to pose: the same matches are wrong in the same way,
    and a filter that takes them for independent becomes too sure. Of a first-order Markov process, whose correlation falls as
    exp(-d / length) over a way d, n observations at steps of d are worth n (1 - r) / (1 + r) independent ones, r the
    correlation from one to the next (Bartlett, 1946). So each counts with its covariance times (1 + r) / (1 - r).
    """

    def __init__(self, length_m: float) -> None:
        self._length_m, self._moved_m = length_m, 0.0
        self._observed: dict[int, float] = {}  # the way at which each was last observed

    def move(self, motion: Floats) -> None:
        """A motion (3,) of odometry."""
        if np.isfinite(motion).all():
            self._moved_m += float(np.hypot(*motion[:2]) + METRES_OF_RADIAN * abs(motion[2]))

    def factor(self, element: int) -> float:
        """Of the covariance of an observation of an element of the map now; 1 of its first, and of independent ones."""
        before = self._observed.get(element)
        self._observed[element] = self._moved_m
        if before is None or self._length_m == 0:
            return 1.0
        r = min(MOST, math.exp(-(self._moved_m - before) / self._length_m))
        return (1 + r) / (1 - r)
