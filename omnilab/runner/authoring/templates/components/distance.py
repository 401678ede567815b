"""A distance: correlation over all rotations of the camera."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from omnilab import (
    Array,
    DataError,
    Distance,
    Floats,
    Match,
    Signatures,
)
from omnilab.geometry import wrap_angle


class Index(NamedTuple):
    """The places of a map, ready to be compared."""

    spectra: Array  # (P, rows, frequencies)
    shape: tuple[int, ...]  # of a signature


@dataclass
class MyDistance:
    """One less the highest correlation of two signatures over all rotations: 0 to 2.

    For signatures whose last axis shifts as the camera rotates. The shift that correlates
    best is the rotation. All shifts at once are one product of spectra (the correlation
    theorem of the Fourier transform).
    """

    def prepare(self, places: Signatures) -> Index:
        """What can be computed once for a map; `match` takes it as `index`."""
        return Index(np.fft.rfft(_standardised(places)), places.place.shape[1:])

    def match(self, queries: Signatures, index: Index) -> Match:
        """Distances and rotations (Q, P) of every query to every place."""
        shape = queries.place.shape[1:]
        if shape != index.shape:
            raise DataError(
                f"queries of shape {shape} cannot be compared with places of shape"
                f" {index.shape}; describe both with the same settings"
            )
        samples = shape[-1]
        distance = np.empty((len(queries), len(index.spectra)), np.float32)
        rotation = np.empty_like(distance)
        for q, spectrum in enumerate(np.fft.rfft(_standardised(queries))):
            products = (spectrum.conj() * index.spectra).sum(axis=1)
            correlation = np.fft.irfft(products, samples)  # (P, shifts)
            distance[q] = 1 - correlation.max(axis=1)
            rotation[q] = wrap_angle(2 * np.pi / samples * correlation.argmax(axis=1))
        return Match(distance, rotation)


def _standardised(signatures: Signatures) -> Floats:
    """Signatures (N, rows, samples) of mean 0 and length 1; zeros stay zeros."""
    values = signatures.place.astype(float)
    rows = values.reshape(len(values), -1, values.shape[-1])
    rows -= rows.mean(axis=(1, 2), keepdims=True)
    length = np.sqrt((rows**2).sum(axis=(1, 2), keepdims=True))
    return np.asarray(rows / np.maximum(length, 1e-12))


# a type checker compares it with the contract:
_: type[Distance] = MyDistance
