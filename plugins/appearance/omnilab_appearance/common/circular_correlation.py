"""Circular cross-correlation of signatures whose last axis shifts under a rotation of the camera."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints, Signatures
from omnilab.geometry import wrap_angle

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Spectra = npt.NDArray[np.complexfloating[Any, Any]]
BestRotations = Callable[[Any, Any, int], tuple[Floats, Floats]]  # as `best_rotations`
HELD = 2**21  # correlation samples held at once


class Headings(NamedTuple):
    """Spectra of a map's `heading` parts, to be correlated with."""

    spectra: Spectra  # (frequencies, rows, P)
    samples: int  # over 360 degrees


def headings_of(places: Signatures) -> Headings | None:
    """The spectra of the `heading` parts of places, if they have one."""
    if places.heading is None:
        return None
    spectra = heading_spectra(places.heading)
    return Headings(np.ascontiguousarray(spectra.transpose(2, 1, 0)), places.heading.shape[-1])


def rotations(queries: Signatures, places: Headings | None, best: BestRotations | None = None) -> Floats | None:
    """Query heading - place heading (Q, P) in [-pi, pi), where both have a `heading` part: the shift of the highest correlation.

    `best` is what finds it, `best_rotations` where there is none.
    """
    if queries.heading is None or places is None:
        return None
    _, rotation = (best or best_rotations)(heading_spectra(queries.heading), *places)
    return wrap_angle(rotation)


def heading_spectra(headings: Floats) -> Spectra:
    """Half spectra (N, rows, frequencies) along the last axis of (N, ..., samples), without means, of unit length.

    Constant headings have no direction: their spectra are zero.
    """
    from scipy import fft

    rows = headings.reshape(len(headings), -1, headings.shape[-1])
    spectra = fft.rfft(rows)[:, :, : (rows.shape[2] + 1) // 2]
    spectra[:, :, 0] = 0
    power = 2 * np.einsum("nrf,nrf->n", spectra, spectra.conj()).real
    length = np.sqrt(power)[:, None, None]
    return np.asarray(np.divide(spectra, length, out=np.zeros_like(spectra), where=length > 0))


def best_rotations(queries: Spectra, places: Spectra, samples: int) -> tuple[Floats, Floats]:
    """The highest circular correlation of Q queries with P places, and its rotation in radians, both (Q, P).

    Spectra are (Q, rows, frequencies) and (frequencies, rows, P): half spectra of real signals of `samples` along the
    axis that shifts. Correlations are summed over the rows, and peaks refined between the samples by a parabola.
    """
    band = np.ascontiguousarray(queries.conj().transpose(2, 0, 1))
    inverse = synthesis(len(places), samples)
    agreement = np.empty((len(queries), places.shape[2]), np.float32)
    rotation = np.empty_like(agreement)
    step = max(1, HELD // (max(1, len(queries)) * samples))

    def compare(start: int) -> None:
        chunk = slice(start, start + step)
        cross = np.matmul(band, places[:, :, chunk])  # (frequencies, queries, places), summed over the rows
        parts = np.concatenate([cross.real, cross.imag]).reshape(2 * len(places), -1)
        peak, shift = _highest(parts.T @ inverse)
        agreement[:, chunk] = peak.reshape(cross.shape[1:])
        rotation[:, chunk] = (2 * np.pi / samples * shift).reshape(cross.shape[1:])

    # one thread a block and none within, so that sums do not depend on the number of threads
    with blas().limit(limits=1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(compare, range(0, places.shape[2], step)))
    return agreement, rotation


@cache
def blas() -> ThreadpoolController:
    """A controller of the threads of numpy's linear algebra, which slow each other down on small matrices."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def synthesis(frequencies: int, samples: int) -> Floats:
    """The inverse DFT as a matrix (2 x frequencies, samples), for real and imaginary parts of half a spectrum."""
    phase = 2 * np.pi * np.outer(np.arange(frequencies), np.arange(samples)) / samples
    twice = np.where(np.arange(frequencies) == 0, 1, 2)[:, None]  # the other half of the spectrum
    return np.concatenate([twice * np.cos(phase), -twice * np.sin(phase)]).astype(np.float32)


def _highest(curves: Floats) -> tuple[Floats, Floats]:
    """The peak of each row (N, samples) and its position, both refined between the samples by a parabola."""
    top = curves.argmax(axis=1)
    every = np.arange(len(curves))
    before, after = curves[every, top - 1], curves[every, (top + 1) % curves.shape[1]]
    return refined(before, curves[every, top], after, top)


def refined(before: Floats, peak: Floats, after: Floats, top: Floats | Ints) -> tuple[Floats, Floats]:
    """A peak and its position, of the highest of three samples, the middle one, which is number `top`."""
    offset = vertex(before, peak, after)
    return peak - 0.25 * (before - after) * offset, top + offset


def vertex(before: Floats, peak: Floats, after: Floats) -> Floats:
    """The vertex, in [-0.5, 0.5], of the parabola through three samples of which the middle one is the highest."""
    bend = before - 2 * peak + after
    offset = np.divide(0.5 * (before - after), bend, out=np.zeros_like(peak), where=bend < 0)
    return np.asarray(np.clip(offset, -0.5, 0.5))
