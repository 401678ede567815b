"""Rotational image difference function, of insect navigation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.circular_correlation import Spectra, vertex
from omnilab_appearance.distances.poc import matrices_of


class DifferenceIndex(NamedTuple):
    """Places, ready to be compared at all rotations."""

    spectra: Spectra  # (P, rows, frequencies)
    power: Floats  # (P,) sums of squares
    shape: tuple[int, ...]  # of a signature


@dataclass
class RotationalDifference:
    """The least root mean square difference of two images over all rotations (Zeil, Hofmann & Chahl, 2003; Philippides et al., 2011).

    For signatures whose last axis shifts as the camera rotates: panoramas as pixels (`descriptor=tiny_image`), as models of
    insects have them. The rotation of the least difference, refined between the columns, is the visual compass. Unlike
    `circular_correlation` it notices brightness and contrast.
    """

    def prepare(self, places: Signatures) -> DifferenceIndex:
        """Spectra of the places."""
        from scipy import fft

        images = matrices_of(places).astype(np.float64)
        return DifferenceIndex(fft.rfft(images), (images**2).sum(axis=(1, 2)), places.place.shape[1:])

    def match(self, queries: Signatures, index: DifferenceIndex) -> Match:
        """Differences and rotations (Q, P)."""
        from scipy import fft

        if queries.place.shape[1:] != index.shape:
            raise DataError(
                f"queries of shape {queries.place.shape[1:]} cannot be compared with places of shape {index.shape};"
                " describe both with the same settings"
            )
        images = matrices_of(queries).astype(np.float64)
        samples, size = index.shape[-1], images[0].size
        least = np.empty((len(images), len(index.power)), np.float32)
        rotation = np.empty_like(least)
        for q, spectrum in enumerate(fft.rfft(images)):
            agreement = fft.irfft(np.einsum("rf,prf->pf", spectrum.conj(), index.spectra), samples)
            top, every = agreement.argmax(axis=1), np.arange(len(agreement))
            square = (images[q] ** 2).sum() + index.power - 2 * agreement[every, top]
            least[q] = np.sqrt(np.maximum(square, 0) / size)
            before, after = agreement[every, top - 1], agreement[every, (top + 1) % samples]
            rotation[q] = wrap_angle(2 * np.pi / samples * (top + vertex(before, agreement[every, top], after)))
        return Match(least, rotation)
