"""What distances between signatures as vectors share: the vectors, and the rotation that headings tell."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import DataError
from omnilab_appearance.common.circular_correlation import Headings, headings_of, rotations


class Index(NamedTuple):
    """A map, ready to be compared with."""

    places: Any  # what the distance keeps of the places
    shape: tuple[int, ...]  # of one signature
    headings: Headings | None


@dataclass
class VectorDistance(ABC):
    """A distance between the `place` parts of signatures, as vectors.

    Where signatures have a `heading` part, the rotation is the shift at which the two headings correlate best.
    """

    def prepare(self, places: Signatures) -> Index:
        """What the distance needs of the places, and their headings' spectra."""
        return Index(self._learn(_flat(places)), places.place.shape[1:], headings_of(places))

    def match(self, queries: Signatures, index: Index) -> Match:
        """Distances (Q, P), and rotations where there are headings."""
        if queries.place.shape[1:] != index.shape:
            raise DataError(
                f"queries of shape {queries.place.shape[1:]} cannot be compared with places of shape {index.shape};"
                " describe both with the same settings"
            )
        distance = np.asarray(self._distances(_flat(queries), index.places), np.float32)
        return Match(distance, rotations(queries, index.headings))

    def _learn(self, places: Floats) -> Any:
        """What to keep of the places (P, D); by default the places."""
        return places

    @abstractmethod
    def _distances(self, queries: Floats, places: Any) -> Floats:
        """Distances (Q, P) of queries (Q, D) to what was kept of the places."""


def _flat(signatures: Signatures) -> Floats:
    return np.ascontiguousarray(signatures.place.reshape(len(signatures), -1), np.float32)


def unit(vectors: Floats) -> Floats:
    """Vectors (N, D) of unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))
