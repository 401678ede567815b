"""Circular cross-correlation distance, over rotations only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Match, Signatures
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.circular_correlation import (
    Headings,
    Spectra,
    best_rotations,
    heading_spectra,
    headings_of,
    rotations,
)
from omnilab_appearance.distances.poc import matrices_of


@dataclass
class CircularCorrelation:
    """1 minus the highest normalised cross-correlation of two signatures over all rotations, in [0, 2].

    For signatures whose last axis shifts as the camera rotates: of every row the mean along that axis is left out, the
    rest is brought to unit length, and the peak's shift, refined between the samples, gives the rotation. A factor on all
    values and an offset on a row change nothing. Unlike `poc_band` it keeps the moduli of the spectra, so
    that what a descriptor has normalised keeps its weight. A signature of constant rows is at distance 1 from all.
    """

    def prepare(self, places: Signatures) -> tuple[Spectra, tuple[int, ...], Headings | None]:
        """Spectra (frequencies, rows, P) of the places, the shape of one signature, and their headings."""
        spectra = heading_spectra(matrices_of(places))
        return np.ascontiguousarray(spectra.transpose(2, 1, 0)), places.place.shape[1:], headings_of(places)

    def match(self, queries: Signatures, index: tuple[Spectra, tuple[int, ...], Headings | None]) -> Match:
        """Distances and rotations (Q, P); rotations are those of the heading parts where there are any."""
        places, shape, headings = index
        if queries.place.shape[1:] != shape:
            raise DataError(
                f"queries of shape {queries.place.shape[1:]} cannot be compared with places of shape {shape};"
                " describe both with the same settings"
            )
        agreement, shift = best_rotations(heading_spectra(matrices_of(queries)), places, shape[-1])
        of_headings = rotations(queries, headings)
        return Match(1 - agreement, wrap_angle(shift) if of_headings is None else of_headings)
