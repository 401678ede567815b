"""Phase-only correlation of a low band, over rotations only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import ConfigError
from omnilab_appearance.poc import unit_phase, vertex

HELD = 2**23  # correlation samples held at once: more queries a product are faster, until memory is the limit


@dataclass
class PocBand:
    """Phase-only correlation of the low frequencies, with no shift but that of a rotation: fast, and the most accurate.

    The high frequencies of two neighbouring images have unrelated phases, and a shift along the offsets is not a motion
    that a robot makes: leaving both out costs nothing and keeps what two images share. The similarity is the mean over
    the band of the cosines of the phase differences, at the best rotation; the distance is 1 minus that, in [0, 2].
    More angle frequencies favour close places, fewer distant ones; the default serves grids from 0.2 to 2 m.
    """

    angle_band: int = 32  # frequencies along the last axis, from 0
    offset_band: int = 30  # frequencies along the other axis, from 0, with both signs

    def __post_init__(self) -> None:
        if self.angle_band < 2 or self.offset_band < 1:
            raise ConfigError(
                f"a band of {self.angle_band} x {self.offset_band} frequencies holds no rotation; give at least 2 x 1"
            )

    def prepare(self, places: Signatures) -> tuple[npt.NDArray[np.complexfloating[Any, Any]], int]:
        """The places' band as (frequencies along angles, frequencies along offsets, P), and the number of angles."""
        return np.ascontiguousarray(self._band(places.place).transpose(2, 1, 0)), places.place.shape[2]

    def match(self, queries: Signatures, index: tuple[npt.NDArray[np.complexfloating[Any, Any]], int]) -> Match:
        """Distances and rotations (Q, P)."""
        places, angles = index
        band = np.ascontiguousarray(self._band(queries.place).conj().transpose(2, 0, 1))
        terms = (2 * len(places) - 1) * places.shape[1]
        synthesis = _synthesis(len(places), angles) / np.float32(terms)
        distance = np.empty((len(queries), places.shape[2]), np.float32)
        rotation = np.empty_like(distance)
        step = max(1, HELD // (places.shape[2] * angles))
        for start in range(0, len(queries), step):
            chunk = slice(start, start + step)
            cross = np.matmul(band[:, chunk], places)  # (frequencies, queries, places), summed over the offsets
            parts = np.concatenate([cross.real, cross.imag]).reshape(2 * len(places), -1)
            peak, shift = _highest(parts.T @ synthesis)
            distance[chunk] = 1 - peak.reshape(cross.shape[1:])
            rotation[chunk] = (2 * np.pi / angles * shift).reshape(cross.shape[1:])
        return Match(distance, (rotation + np.pi) % (2 * np.pi) - np.pi)

    def _band(self, matrices: Floats) -> npt.NDArray[np.complexfloating[Any, Any]]:
        """Unit-phase spectra (N, offset frequencies, angle frequencies), cut to the band."""
        spectra = unit_phase(matrices)
        offsets = np.fft.fftfreq(spectra.shape[1], 1 / spectra.shape[1])
        return spectra[:, np.abs(offsets) < self.offset_band, : min(self.angle_band, (matrices.shape[2] + 1) // 2)]


def _synthesis(frequencies: int, angles: int) -> Floats:
    """(2 x frequencies, angles): from the real and imaginary parts of half a spectrum to the correlation itself."""
    turns = 2 * np.pi * np.outer(np.arange(frequencies), np.arange(angles)) / angles
    twice = np.where(np.arange(frequencies) == 0, 1, 2)[:, None]  # a real signal's other half
    return np.concatenate([twice * np.cos(turns), -twice * np.sin(turns)]).astype(np.float32)


def _highest(curves: Floats) -> tuple[Floats, Floats]:
    """The peak of each row (N, angles) and where it lies, both refined between the samples by a parabola."""
    top = curves.argmax(axis=1)
    every = np.arange(len(curves))
    peak = curves[every, top]
    before, after = curves[every, top - 1], curves[every, (top + 1) % curves.shape[1]]
    offset = vertex(before, peak, after)
    return peak - 0.25 * (before - after) * offset, top + offset
