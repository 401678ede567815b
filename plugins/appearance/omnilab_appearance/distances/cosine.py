"""Cosine distance."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Floats
from omnilab_appearance.common.vectors import unit
from omnilab_appearance.distances.vector_distance import VectorDistance


@dataclass
class Cosine(VectorDistance):
    """1 - the cosine of the angle between two signatures (Payá et al., 2016, eq. 10-11), in [0, 2].

    A signature of zeros is at distance 1 from all. The rotation comes from the headings, where there are any.
    """

    def _fit(self, places: Floats) -> Floats:
        return unit(places)

    def _distances(self, queries: Floats, places: Floats) -> Floats:
        return 1 - unit(queries) @ places.T
