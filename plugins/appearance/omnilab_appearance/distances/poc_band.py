"""Low-pass phase-only correlation distance, over rotations only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Match, Signatures, check_settings, setting
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.circular_correlation import Headings, Spectra, best_rotations, headings_of, rotations
from omnilab_appearance.distances.poc import in_chunks, matrices_of, unit_phase

CUT = 2.5  # standard deviations at which the band ends


@dataclass
class PocBand:
    """Phase-only correlation of the low frequencies, with no shift but that of a rotation: fast, and the most accurate.

    The high frequencies of two neighbouring images have unrelated phases, and a shift along the offsets is not a motion
    that a robot makes: leaving both out costs nothing and keeps what two images share. The band fades out like a
    Gaussian. The similarity is the weighted mean over the band of the cosines of the phase differences, at the best
    rotation; the distance is 1 minus that, in [0, 2].
    """

    angle_band: float = setting(24.0, above=0)  # standard deviation of the band along the last axis, in frequencies
    offset_band: float = setting(20.0, above=0)  # the same along the other axis

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Signatures) -> tuple[Spectra, int, Headings | None]:
        """The band as (frequencies along angles, frequencies along offsets, P), the number of angles, the headings."""
        band = in_chunks(self._band, matrices_of(places))
        return np.ascontiguousarray(band.transpose(2, 1, 0)), places.place.shape[2], headings_of(places)

    def match(self, queries: Signatures, index: tuple[Spectra, int, Headings | None]) -> Match:
        """Distances and rotations (Q, P); rotations are those of the heading parts where there are any."""
        places, angles, headings = index
        agreement, shift = self._best_rotations(self._band(matrices_of(queries)), places, angles)
        of_headings = rotations(queries, headings, self._best_rotations)
        return Match(1 - agreement, wrap_angle(shift) if of_headings is None else of_headings)

    def _best_rotations(self, queries: Spectra, places: Spectra, samples: int) -> tuple[Floats, Floats]:
        return best_rotations(queries, places, samples)

    def _band(self, matrices: Floats) -> Spectra:
        """Unit-phase spectra (N, offset frequencies, angle frequencies), each times the root of its weight."""
        rows, columns = matrices.shape[1:]
        offsets, angles = np.fft.fftfreq(rows, 1 / rows), np.arange((columns + 1) // 2)
        offsets_in = np.abs(offsets) <= CUT * self.offset_band
        angles_in = angles <= CUT * self.angle_band
        spectra = unit_phase(matrices)[:, offsets_in][:, :, : angles_in.sum()]
        along_offsets = np.exp(-0.5 * (offsets[offsets_in] / self.offset_band) ** 2)
        along_angles = np.exp(-0.5 * (angles[angles_in] / self.angle_band) ** 2)
        weight = along_offsets[:, None] * along_angles
        weight /= weight[:, 0].sum() + 2 * weight[:, 1:].sum()  # the other half of a real signal's spectrum is the same
        return np.asarray(spectra * np.sqrt(weight).astype(np.float32))
