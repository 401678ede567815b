"""Gaussian blur of a picture, compiled: two rows at a time, for which each pixel is read once.

To the last bit what OpenCV makes of it on processors with AVX2. Sums along rows run from left to right, sums along columns from the
middle outwards; a product is added without being rounded, but in the last columns, behind the last whole vector, it is rounded
(along rows in whole fours).
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from numba.extending import intrinsic

BLOCK = (
    32  # rows, an even number, that are blurred along before they are blurred across: they lie in the processor's cache
)
TILE = 512  # columns of them that lie in its first one
ALONG, ACROSS = 4, 8  # columns of OpenCV's vectors in either direction
ONE = nb.uintp(1)  # indices without a sign are not looked at for being negative, and loops over them become vector code


@intrinsic  # type: ignore[untyped-decorator]  # numba says nothing of types
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001
    """a b + c of float32, rounded once."""
    real = nb.types.float32
    return real(real, real, real), lambda context, builder, signature, values: builder.fma(*values)  # noqa: ARG005


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blurred(picture, taps, half, out, start, stop):  # type: ignore[no-untyped-def]
    """Write rows start to below stop of a picture (H, W), blurred by taps (2 reach + 1,), to `out` (H, W).

    Of `half`, a tuple, the length counts, which is the reach: it tells the compiler how long the loops over taps are.
    """
    (height, width), reach = picture.shape, len(half)
    rows = np.empty((BLOCK + 2 * reach, width), np.float32)
    bordered, spare = np.empty(width + 2 * reach, np.float32), np.empty(width, np.float32)
    for v in range(start, stop, BLOCK):
        count, kept = min(BLOCK, stop - v), 0
        if v > start:
            kept = 2 * reach
            for j in range(kept):
                copied(rows[BLOCK + j], rows[j])
        for j in range(kept, count + 2 * reach):
            at = abs(v - reach + j)
            mirrored(picture[at if at < height else 2 * (height - 1) - at], reach, bordered)
            along(bordered, taps, half, rows[j])
        for low in range(0, width - width % ACROSS, TILE):
            high = min(low + TILE, width - width % ACROSS)
            for j in range(0, count, 2):
                other = out[v + j + 1] if j + 1 < count else spare
                across_two(rows[j:], taps, half, out[v + j], other, low, high)
        for j in range(count):
            last_across(rows[j:], taps, out[v + j], width - width % ACROSS)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def copied(row, out):  # type: ignore[no-untyped-def]
    """A row, written to `out`: in a vector loop, which an assignment is not."""
    for u in range(len(row)):
        out[u] = row[u]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def mirrored(row, reach, out):  # type: ignore[no-untyped-def]
    """A row (W,) with its pixels beyond either end in mirror order, written to `out` (W + 2 reach,)."""
    width = len(row)
    copied(row, out[reach : reach + width])
    for i in range(1, reach + 1):
        out[reach - i] = row[i]
        out[reach - 1 + width + i] = row[width - 1 - i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def along(row, taps, half, out):  # type: ignore[no-untyped-def]
    """A row (W + 2 reach,), blurred: (W,)."""
    whole = len(out) - len(out) % ALONG
    for u in range(nb.uintp(whole)):
        total = row[u] * taps[0]
        for i in range(ONE, nb.uintp(2 * len(half) + 1)):
            total = fma(row[u + i], taps[i], total)
        out[u] = total
    for u in range(whole, len(out)):
        total, rounded = row[u] * taps[0], len(taps) // ALONG * ALONG
        for i in range(1, rounded + 1):
            total += row[u + i] * taps[i]
        for i in range(rounded + 1, len(taps)):
            total = fma(row[u + i], taps[i], total)
        out[u] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def across_two(rows, taps, half, one, other, low, high):  # type: ignore[no-untyped-def]
    """Columns low to below high of the middle row of the first 2 reach + 1 rows, and of the row after it, blurred."""
    middle, after = nb.uintp(len(half)), nb.uintp(len(half) + 1)
    for u in range(nb.uintp(low), nb.uintp(high)):
        above, below = rows[middle, u], rows[after, u]
        first, second = above * taps[middle], below * taps[middle]
        for i in range(ONE, after):
            higher, lower = rows[middle - i, u], rows[after + i, u]
            first, second = fma(higher + below, taps[middle + i], first), fma(above + lower, taps[middle + i], second)
            above, below = higher, lower
        one[u], other[u] = first, second


@nb.njit(cache=True, nogil=True, error_model="numpy")
def last_across(rows, taps, out, first):  # type: ignore[no-untyped-def]
    """The columns from one on of what `across_two` makes of the first row, products rounded."""
    reach = len(taps) // 2
    for u in range(first, len(out)):
        total = rows[reach, u] * taps[reach]
        for i in range(1, reach + 1):
            total += (rows[reach - i, u] + rows[reach + i, u]) * taps[reach + i]
        out[u] = total
