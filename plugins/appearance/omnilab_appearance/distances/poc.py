"""Phase-only correlation distance, as printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.circular_correlation import Headings, Spectra, headings_of, rotations

PocIndex = tuple[Spectra, tuple[int, int], Headings | None]
CHUNK = 64  # matrices transformed at once: what fits the cache


@dataclass
class Poc:
    """Phase-only correlation over all shifts, 1 - max C (Berenguer, thesis, eq. 2.12-2.14, 4.2).

    Signatures are matrices whose last axis shifts as the camera rotates. The peak's shift along that axis, refined
    between samples (Foroosh et al., 2002), gives the rotation; the shift along the other axis is free.
    """

    def prepare(self, places: Signatures) -> PocIndex:
        """Unit-phase spectra of the places, the shape of their signatures, and their headings."""
        return in_chunks(unit_phase, matrices_of(places)), places.place.shape[1:], headings_of(places)

    def match(self, queries: Signatures, index: PocIndex) -> Match:
        """Distances and rotations (Q, P); rotations are those of the heading parts where there are any."""
        spectra, shape, headings = index
        distance = np.empty((len(queries), len(spectra)), np.float32)
        rotation = np.empty_like(distance)
        for q, query in enumerate(unit_phase(matrices_of(queries))):
            for start in range(0, len(spectra), CHUNK):
                chunk = slice(start, start + CHUNK)
                peak, shift = highest(correlate(query, spectra[chunk], shape))
                distance[q, chunk] = 1 - peak
                rotation[q, chunk] = 2 * np.pi / shape[1] * shift
        of_headings = rotations(queries, headings)
        return Match(distance, wrap_angle(rotation) if of_headings is None else of_headings)


def matrices_of(signatures: Signatures) -> Floats:
    """The signatures as matrices (N, rows, columns); DataError for signatures of another shape."""
    if signatures.place.ndim != 3:
        raise DataError(
            f"signatures of shape {signatures.place.shape[1:]} have no two axes to correlate; choose distance=euclidean"
        )
    return signatures.place


def unit_phase(matrices: Floats) -> Spectra:
    """Half spectra (N, rows, columns / 2 + 1) of matrices (N, rows, columns), every coefficient scaled to modulus 1.

    Coefficients that are zero have no phase and stay zero.
    """
    from scipy import fft

    spectra = fft.rfft2(matrices, workers=-1)
    modulus = np.abs(spectra)
    return np.divide(spectra, modulus, out=np.zeros_like(spectra), where=modulus > 0)


def in_chunks(transform: Callable[[Floats], Spectra], matrices: Floats) -> Spectra:
    """`transform` of all matrices, in chunks of bounded memory."""
    first = transform(matrices[:CHUNK])
    result = np.empty((len(matrices), *first.shape[1:]), first.dtype)
    result[:CHUNK] = first
    for start in range(CHUNK, len(matrices), CHUNK):
        result[start : start + CHUNK] = transform(matrices[start : start + CHUNK])
    return result


def correlate(query: Spectra, places: Spectra, shape: tuple[int, int]) -> Floats:
    """Phase-only correlation surfaces (P, rows, columns) of one query with P places."""
    from scipy import fft

    return np.asarray(fft.irfft2(places * query.conj(), s=shape, workers=-1))


def highest(surfaces: Floats) -> tuple[Floats, Floats]:
    """The highest sample of each surface (P, rows, columns) and its column (P,), refined between the samples."""
    count, _, columns = surfaces.shape
    row, column = np.divmod(surfaces.reshape(count, -1).argmax(axis=1), columns)
    every = np.arange(count)
    peak = surfaces[every, row, column]
    before, after = surfaces[every, row, column - 1], surfaces[every, row, (column + 1) % columns]
    return peak, column + between(before, peak, after)


def between(before: Floats, peak: Floats, after: Floats) -> Floats:
    """The peak of a phase correlation, in [-0.5, 0.5] from the highest of three samples, the middle one.

    The correlation of two shifted copies is a sinc, whose position follows from its two highest samples (Foroosh,
    Zerubia and Berthod, 2002); a parabola would pull it to the middle by up to 0.2 samples.
    """
    higher = np.maximum(np.maximum(before, after), 0)
    share = np.divide(higher, higher + peak, out=np.zeros_like(peak), where=higher + peak > 0)
    return np.asarray(np.where(after > before, share, -share))
