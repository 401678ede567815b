"""Phase-only correlation distance, as printed."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from omnilab.api import Array, Floats, Match, Signatures
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.circular_correlation import (
    Headings,
    Spectra,
    best_rotations,
    blas,
    headings_of,
    rotations,
)

PocIndex = tuple[Floats, int, Headings | None]
CHUNK = 64  # matrices transformed at once: what fits the cache
AT_ONCE = 2  # surfaces at once: what stays in the cache of a core from one product to the next


@dataclass
class Poc:
    """Phase-only correlation over all shifts, 1 - max C (Berenguer, thesis, eq. 2.12-2.14, 4.2).

    Signatures are matrices whose last axis shifts as the camera rotates. The peak's shift along that axis, refined
    between samples (Foroosh et al., 2002), gives the rotation; the shift along the other axis is free.
    """

    def prepare(self, places: Signatures) -> PocIndex:
        """Unit-phase spectra of the places as planes (P, rows, 2, frequencies), the number of columns, and headings."""
        from omnilab_appearance.distances.phase_surfaces import planes_of

        matrices = matrices_of(places)
        columns = matrices.shape[2]
        planes = in_chunks(lambda some: planes_of(unit_phase(some), columns), matrices)
        return planes, columns, headings_of(places)

    def match(self, queries: Signatures, index: PocIndex) -> Match:
        """Distances and rotations (Q, P); rotations are those of the heading parts where there are any."""
        places, columns, headings = index
        found = self._peaks(unit_phase(matrices_of(queries)), places, columns)
        of_headings = rotations(queries, headings, self._best_rotations)
        if of_headings is not None:
            return Match(1 - found[0], of_headings)
        shift = found[3] + between(found[1], found[0], found[2])
        return Match(1 - found[0], wrap_angle(2 * np.pi / columns * shift))

    def _peaks(self, queries: Spectra, places: Floats, columns: int) -> Floats:
        """Of each surface (4, Q, P): the highest sample, those before and after it along its row, and its column."""
        from omnilab_appearance.distances.phase_surfaces import planes_of

        return all_peaks(planes_of(queries, columns), places, columns)

    def _best_rotations(self, queries: Spectra, places: Spectra, samples: int) -> tuple[Floats, Floats]:
        return best_rotations(queries, places, samples)


def all_peaks(queries: Floats, places: Floats, columns: int) -> Floats:
    """`peaks` (4, Q, P) of every query with every place."""
    from omnilab_appearance.distances.phase_surfaces import peaks, scratch

    found = np.empty((4, len(queries), len(places)), np.float32)

    def compare(start: int) -> None:
        memory = scratch(places[:AT_ONCE], columns)
        for first in range(start, min(start + CHUNK, len(places)), AT_ONCE):
            some = places[first : first + AT_ONCE]
            held = memory if len(some) == AT_ONCE else scratch(some, columns)
            for q, query in enumerate(queries):
                found[:, q, first : first + AT_ONCE] = peaks(query, some, columns, held)

    # one thread a chunk and none within, so that sums do not depend on the number of threads
    with blas().limit(limits=1, user_api="blas"):
        if len(places) <= CHUNK:
            compare(0)
            return found
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(compare, range(0, len(places), CHUNK)))
    return found


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


def in_chunks(transform: Callable[[Floats], Array], matrices: Floats) -> Array:
    """`transform` of all matrices, in chunks of bounded memory."""
    first = transform(matrices[:CHUNK])
    result = np.empty((len(matrices), *first.shape[1:]), first.dtype)
    result[:CHUNK] = first
    for start in range(CHUNK, len(matrices), CHUNK):
        result[start : start + CHUNK] = transform(matrices[start : start + CHUNK])
    return result


def between(before: Floats, peak: Floats, after: Floats) -> Floats:
    """The peak of a phase correlation, in [-0.5, 0.5] from the highest of three samples, the middle one.

    The correlation of two shifted copies is a sinc, whose position follows from its two highest samples (Foroosh,
    Zerubia and Berthod, 2002); a parabola would pull it to the middle by up to 0.2 samples.
    """
    higher = np.maximum(np.maximum(before, after), 0)
    share = np.divide(higher, higher + peak, out=np.zeros_like(peak), where=higher + peak > 0)
    return np.asarray(np.where(after > before, share, -share))
