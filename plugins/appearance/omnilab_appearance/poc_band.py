"""Phase-only correlation of a low band, over rotations only."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Match, Signatures
from omnilab.errors import ConfigError
from omnilab.geometry import wrap_angle
from omnilab_appearance.poc import in_chunks, matrices_of, unit_phase, vertex

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Spectra = npt.NDArray[np.complexfloating[Any, Any]]
HELD = 2**21  # correlation samples held at once: what the cache and the memory like
CUT = 2.5  # standard deviations at which the band ends


@dataclass
class PocBand:
    """Phase-only correlation of the low frequencies, with no shift but that of a rotation: fast, and the most accurate.

    The high frequencies of two neighbouring images have unrelated phases, and a shift along the offsets is not a motion
    that a robot makes: leaving both out costs nothing and keeps what two images share. The band fades out like a
    Gaussian. The similarity is the weighted mean over the band of the cosines of the phase differences, at the best
    rotation; the distance is 1 minus that, in [0, 2].
    """

    angle_band: float = 24.0  # standard deviation of the band along the last axis, in frequencies
    offset_band: float = 20.0  # the same along the other axis

    def __post_init__(self) -> None:
        if not (self.angle_band > 0 and self.offset_band > 0):
            raise ConfigError(
                f"a band of {self.angle_band:g} x {self.offset_band:g} frequencies holds nothing; give two numbers above 0"
            )

    def prepare(self, places: Signatures) -> tuple[Spectra, int]:
        """The places' band as (frequencies along angles, frequencies along offsets, P), and the number of angles."""
        band = in_chunks(self._band, matrices_of(places))
        return np.ascontiguousarray(band.transpose(2, 1, 0)), places.place.shape[2]

    def match(self, queries: Signatures, index: tuple[Spectra, int]) -> Match:
        """Distances and rotations (Q, P)."""
        places, angles = index
        band = np.ascontiguousarray(self._band(matrices_of(queries)).conj().transpose(2, 0, 1))
        synthesis = _synthesis(len(places), angles)
        distance = np.empty((len(queries), places.shape[2]), np.float32)
        rotation = np.empty_like(distance)
        step = max(1, HELD // (max(1, len(queries)) * angles))

        def compare(start: int) -> None:
            chunk = slice(start, start + step)
            cross = np.matmul(band, places[:, :, chunk])  # (frequencies, queries, places), summed over the offsets
            parts = np.concatenate([cross.real, cross.imag]).reshape(2 * len(places), -1)
            peak, shift = _highest(parts.T @ synthesis)
            distance[:, chunk] = 1 - peak.reshape(cross.shape[1:])
            rotation[:, chunk] = (2 * np.pi / angles * shift).reshape(cross.shape[1:])

        # a thread a block, and none within: the sums do not depend on their number, and they do not wait for each other
        with _blas().limit(limits=1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(compare, range(0, places.shape[2], step)))
        return Match(distance, wrap_angle(rotation))

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


@cache
def _blas() -> ThreadpoolController:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _synthesis(frequencies: int, angles: int) -> Floats:
    """(2 x frequencies, angles): from the real and imaginary parts of half a spectrum to the correlation itself."""
    turns = 2 * np.pi * np.outer(np.arange(frequencies), np.arange(angles)) / angles
    twice = np.where(np.arange(frequencies) == 0, 1, 2)[:, None]  # the other half of the spectrum
    return np.concatenate([twice * np.cos(turns), -twice * np.sin(turns)]).astype(np.float32)


def _highest(curves: Floats) -> tuple[Floats, Floats]:
    """The peak of each row (N, angles) and where it lies, both refined between the samples by a parabola."""
    top = curves.argmax(axis=1)
    every = np.arange(len(curves))
    peak = curves[every, top]
    before, after = curves[every, top - 1], curves[every, (top + 1) % curves.shape[1]]
    offset = vertex(before, peak, after)
    return peak - 0.25 * (before - after) * offset, top + offset
