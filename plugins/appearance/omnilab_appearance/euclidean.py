"""The Euclidean distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Match, Signatures


@dataclass
class Euclidean:
    """Euclidean distance between signatures as vectors (Berenguer, thesis, eq. 2.11). Gives no rotation.

    Computed by one matrix product on signatures less the map's mean, in single precision: distances far below
    a thousandth of the signatures' spread are rounding.
    """

    def prepare(self, places: Signatures) -> tuple[Floats, Floats, Floats]:
        """The mean place, the places less that mean (P, D), and their squared lengths (P,)."""
        flat = places.place.reshape(len(places), -1)
        mean = flat.mean(axis=0)
        centred = flat - mean
        return mean, centred, np.einsum("pd,pd->p", centred, centred)

    def match(self, queries: Signatures, index: tuple[Floats, Floats, Floats]) -> Match:
        """Distances (Q, P)."""
        mean, places, squares = index
        centred = queries.place.reshape(len(queries), -1) - mean
        squared = np.einsum("qd,qd->q", centred, centred)[:, None] + squares - 2 * (centred @ places.T)
        return Match(np.sqrt(np.maximum(squared, 0), dtype=np.float32))
