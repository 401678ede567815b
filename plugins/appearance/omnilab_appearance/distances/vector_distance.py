"""The base class of distances between signatures as vectors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import DataError
from omnilab_appearance.common.circular_correlation import Headings, Spectra, best_rotations, headings_of, rotations


class VectorIndex(NamedTuple):
    """A map prepared for a vector distance."""

    places: Any  # what `_fit` returned
    shape: tuple[int, ...]  # of one signature
    headings: Headings | None


@dataclass
class VectorDistance(ABC):
    """A distance between the `place` parts of signatures, as vectors.

    Where signatures have a `heading` part, the rotation is the shift at which the two headings correlate best.
    """

    def prepare(self, places: Signatures) -> VectorIndex:
        """The precomputed places, and their headings' spectra."""
        return VectorIndex(self._fit(_flat(places)), places.place.shape[1:], headings_of(places))

    def match(self, queries: Signatures, index: VectorIndex) -> Match:
        """Distances (Q, P), and rotations where there are headings."""
        if queries.place.shape[1:] != index.shape:
            raise DataError(
                f"queries of shape {queries.place.shape[1:]} cannot be compared with places of shape {index.shape};"
                " describe both with the same settings"
            )
        distance = np.asarray(self._distances(_flat(queries), index.places), np.float32)
        return Match(distance, rotations(queries, index.headings, self._best_rotations))

    def _fit(self, places: Floats) -> Any:
        """What is precomputed from the places (P, D); by default the places themselves."""
        return places

    def _best_rotations(self, queries: Spectra, places: Spectra, samples: int) -> tuple[Floats, Floats]:
        return best_rotations(queries, places, samples)

    @abstractmethod
    def _distances(self, queries: Floats, places: Any) -> Floats:
        """Distances (Q, P) of queries (Q, D) from places as `_fit` returned them."""


def _flat(signatures: Signatures) -> Floats:
    return np.ascontiguousarray(signatures.place.reshape(len(signatures), -1), np.float32)
