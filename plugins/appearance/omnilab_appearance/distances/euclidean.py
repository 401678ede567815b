"""Euclidean distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab_appearance.distances.vector_distance import VectorDistance


@dataclass
class Euclidean(VectorDistance):
    """Euclidean distance between signatures as vectors (Berenguer, thesis, eq. 2.11).

    Computed by one matrix product on signatures less the map's mean, in single precision: distances far below
    a thousandth of the signatures' spread are rounding. The rotation comes from the headings, where there are any.
    """

    def _fit(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """The mean place, the places less that mean (P, D), and their squared lengths (P,)."""
        mean = places.mean(axis=0)
        centred = places - mean
        return mean, centred, np.einsum("pd,pd->p", centred, centred)

    def _distances(self, queries: Floats, places: tuple[Floats, Floats, Floats]) -> Floats:
        mean, centred_places, squares = places
        centred = queries - mean
        squared = np.einsum("qd,qd->q", centred, centred)[:, None] + squares - 2 * (centred @ centred_places.T)
        return np.asarray(np.sqrt(np.maximum(squared, 0)))
