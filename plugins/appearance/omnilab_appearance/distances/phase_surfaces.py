"""Correlation surfaces of one query with many places, by matrix products, and their highest samples.

The inverse DFT of (rows, columns) is two products with matrices of cosines and sines, each of a quarter of the surface's
symmetry classes: rows r and -r, columns c, -c, and those half a turn on, are sums and differences of the same products. Rows
of a Radon transform (173, a prime) are what an FFT is slow at, and products run at the processor's full rate.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numba as nb
import numpy as np

from omnilab.api import Floats, Ints
from omnilab_appearance.common.circular_correlation import Spectra

NO_NAN = {"nnan", "nsz"}


class Synthesis(NamedTuple):
    """The matrices of surfaces of one shape, single precision."""

    frequencies: tuple[slice, slice]  # along the columns, of the half spectrum: even, odd (none where columns are odd)
    row_cos: Floats  # (rows / 2 + 1, rows / 2 + 1)
    row_sin: Floats
    column_cos: tuple[Floats, Floats]  # even and odd frequencies (F, columns / 4 + 1), or (F, columns / 2 + 1)
    column_sin: tuple[Floats, Floats]


@cache
def synthesis(rows: int, columns: int) -> Synthesis:
    """Inverse DFT of half spectra (rows, columns / 2 + 1)."""
    half = np.arange(rows // 2 + 1)
    along_rows = 2 * np.pi / rows * (np.outer(half, half) % rows)
    once = np.where(2 * half % rows == 0, 0.5, 1)  # these rows are their own opposites
    order = frequency_order(columns)
    turn = columns if columns % 2 else columns // 2
    along_columns = 2 * np.pi / columns * (np.outer(order, np.arange(turn // 2 + 1)) % columns)
    weight = np.where((order == 0) | (2 * order == columns), 1, 2)[:, None] / (rows * columns)
    even = len(order) if columns % 2 else (len(order) + 1) // 2
    column_cos, column_sin = ((weight * of(along_columns)).astype(np.float32) for of in (np.cos, np.sin))
    return Synthesis(
        (slice(0, even), slice(even, None)),
        (once * np.cos(along_rows)).astype(np.float32),
        np.sin(along_rows).astype(np.float32),
        (column_cos[:even], column_cos[even:]),
        (column_sin[:even], column_sin[even:]),
    )


def frequency_order(columns: int) -> Ints:
    """The frequencies of half a spectrum, the even ones first where columns are even."""
    every = np.arange(columns // 2 + 1)
    return every if columns % 2 else np.concatenate([every[::2], every[1::2]])


def planes_of(spectra: Spectra, columns: int) -> Floats:
    """Half spectra (N, rows, F) as real and imaginary planes (N, rows, 2, F), frequencies in the order of the products."""
    planes = np.empty((*spectra.shape[:2], 2, spectra.shape[2]), np.float32)
    step = 1 if columns % 2 else 2
    even = len(range(0, spectra.shape[2], step))
    for plane, part in enumerate((spectra.real, spectra.imag)):
        planes[:, :, plane, :even] = part[:, :, ::step]
        planes[:, :, plane, even:] = part[:, :, 1::2][:, :, : spectra.shape[2] - even]
    return planes


class Scratch(NamedTuple):
    """Memory for the surfaces of a few places, used again and again."""

    folded: Floats  # (2, rows / 2 + 1, P, 2 F): sums, differences
    along_rows: Floats  # the same
    parts: Floats  # (8, rows / 2 + 1, P, columns / 4 + 1)


def scratch(places: Floats, columns: int) -> Scratch:
    """Memory for the surfaces of some places, as `peaks` takes them."""
    count, rows, _, frequencies = places.shape
    spectra = 2, rows // 2 + 1, count, 2 * frequencies
    parts = 8, rows // 2 + 1, count, synthesis(rows, columns).column_cos[0].shape[1]
    return Scratch(np.empty(spectra, np.float32), np.empty(spectra, np.float32), np.empty(parts, np.float32))


def peaks(query: Floats, places: Floats, columns: int, memory: Scratch) -> Floats:
    """The highest sample, those before and after it along its row, and its column: (4, P).

    `query` (rows, 2, F) and `places` (P, rows, 2, F) are planes of half spectra.
    """
    _, rows, _, frequencies = places.shape
    by = synthesis(rows, columns)
    fold(query, places, memory.folded.reshape(2, -1, len(places), 2, frequencies))
    for which, matrix in enumerate((by.row_cos, by.row_sin)):
        np.matmul(matrix, _flat(memory.folded[which]), out=_flat(memory.along_rows[which]))
    products = ((0, 0, by.column_cos), (0, 1, by.column_sin), (1, 1, by.column_cos), (1, 0, by.column_sin))
    for k, (which, plane, matrices) in enumerate(products):
        ordered = memory.along_rows[which].reshape(-1, 2 * frequencies)[
            :, plane * frequencies : (plane + 1) * frequencies
        ]
        for parity, matrix in enumerate(matrices):
            out = memory.parts[2 * k + parity].reshape(len(ordered), -1)
            np.matmul(ordered[:, by.frequencies[parity]], matrix, out=out)
    return np.asarray(highest(memory.parts, columns))


def _flat(spectra: Floats) -> Floats:
    return spectra.reshape(len(spectra), -1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fold(query, places, folded):  # type: ignore[no-untyped-def]
    """Spectra of places times the conjugate one of the query: the sum and the difference of rows o and -o.

    A row that is its own opposite is twice in the sum: `synthesis` halves it.
    """
    count, rows, _, frequencies = places.shape
    for p in range(count):
        for o in range(rows // 2 + 1):
            m = (rows - o) % rows
            for f in range(frequencies):
                a, b, c, d = places[p, o, 0, f], places[p, o, 1, f], query[o, 0, f], query[o, 1, f]
                g, h, i, j = places[p, m, 0, f], places[p, m, 1, f], query[m, 0, f], query[m, 1, f]
                x, y, z, w = a * c + b * d, b * c - a * d, g * i + h * j, h * i - g * j
                folded[0, o, p, 0, f] = x + z
                folded[0, o, p, 1, f] = y + w
                folded[1, o, p, 0, f] = x - z
                folded[1, o, p, 1, f] = y - w


@nb.njit(cache=True, nogil=True, error_model="numpy")
def highest(parts, columns):  # type: ignore[no-untyped-def]
    """`peaks` of the eight products (8, rows / 2 + 1, P, columns / 4 + 1)."""
    found = np.empty((4, parts.shape[2]), np.float32)
    for p in range(parts.shape[2]):
        best, row = -np.inf, 0
        for r in range(parts.shape[1]):
            top = _top(parts[0, r, p], parts[1, r, p], parts[2, r, p], parts[3, r, p],
                       parts[4, r, p], parts[5, r, p], parts[6, r, p], parts[7, r, p])  # fmt: skip
            if top > best:
                best, row = top, r
        peak, side, column = -np.inf, 1, 0
        for sign in (1, -1):
            for c in range(columns):
                value = _sample(parts, row, p, sign, c, columns)
                if value > peak:
                    peak, side, column = value, sign, c
        found[0, p], found[3, p] = peak, column
        found[1, p] = _sample(parts, row, p, side, (column - 1) % columns, columns)
        found[2, p] = _sample(parts, row, p, side, (column + 1) % columns, columns)
    return found


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=NO_NAN)
def _top(a, b, c, d, e, f, g, h):  # type: ignore[no-untyped-def]
    """The highest sample of rows r and -r."""
    top = np.float32(-np.inf)
    for t in range(len(a)):
        x, y, z, w = a[t] + b[t], c[t] + d[t], e[t] + f[t], g[t] + h[t]
        first = x + max(abs(z + w) - y, abs(z - w) + y)
        x, y, z, w = a[t] - b[t], c[t] - d[t], e[t] - f[t], g[t] - h[t]
        top = max(top, first, x + max(abs(z + w) - y, abs(z - w) + y))
    return top


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sample(parts, r, p, side, column, columns):  # type: ignore[no-untyped-def]
    """The surface at row r (side 1) or -r (side -1) and a column."""
    turn = columns if columns % 2 else columns // 2
    half, t, mirrored = np.float32(1), column, np.float32(1)
    if t >= turn:
        t, half = t - turn, -half
    if t > turn // 2:
        t, mirrored = turn - t, -mirrored
        if columns % 2 == 0:
            half = -half
    x = parts[0, r, p, t] + half * parts[1, r, p, t]
    y = parts[2, r, p, t] + half * parts[3, r, p, t]
    z = parts[4, r, p, t] + half * parts[5, r, p, t]
    w = parts[6, r, p, t] + half * parts[7, r, p, t]
    return x - mirrored * y - side * (z + mirrored * w)
