"""Correlation distance."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Floats
from omnilab_appearance.common.vectors import unit
from omnilab_appearance.distances.vector_distance import VectorDistance


@dataclass
class Pearson(VectorDistance):
    """1 - r, r being Pearson's correlation coefficient of two signatures (Payá et al., 2016, eq. 8-9), in [0, 2].

    A signature whose components are all equal correlates with nothing: its distances are 1. The rotation comes from
    the headings, where there are any.
    """

    def _fit(self, places: Floats) -> Floats:
        return unit(places - places.mean(axis=1, keepdims=True))

    def _distances(self, queries: Floats, places: Floats) -> Floats:
        return 1 - unit(queries - queries.mean(axis=1, keepdims=True)) @ places.T
