"""Numba kernels of SIFT (Lowe, 2004): extrema of the scale space, their orientations and their vectors.

A keypoint is a row x, y, layer, response of one octave: pixels of that octave, layers with their fraction.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

INNER = 5  # pixels from the border within which no extremum is looked for
SETTLED = 2  # in a mask of extrema: one that another has led to
STEPS = 5  # of the search for the extremum between the samples
CURVED = 10.0  # ratio of the principal curvatures above which an extremum is an edge
DIRECTIONS = 36  # of a keypoint's surroundings
WIDE = 1.5  # of the surroundings whose direction a keypoint has, in scales
CELL = 3.0  # side of a cell of the vector, in scales
STEP = 2  # pixels from one gradient to the next
CELLS, BINS = 4, 8  # of the vector, a side and in each
LARGEST = 0.2  # of an entry of a vector of unit length
UNIT = 512.0  # the length of vectors in bytes
TURN = 2 * math.pi
EDGE = CELLS / 2 + 0.5  # of what falls into a cell, from the middle, in cells
TINY, QUARTER, HALF, ONE = (np.float32(value) for value in (1e-20, 0.25, 0.5, 1.0))
# the arc tangent in turns, of 0 to 1, by a fit with least maximum error
POLYNOMIAL = tuple(np.float32(value) for value in (0.15902982, -0.05111659, 0.0232787, -0.00620488))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def extrema(pictures, least, mask, start, stop):  # type: ignore[no-untyped-def]
    """Mark in a mask (P - 3, H, W) of bytes the inner layers' pixels that no neighbour exceeds and that exceed `least`.

    Of the rows from start to below stop of P pictures (P, H, W). A layer is the difference of a picture and the one before:
    three rows of each are made at a time, which stay in the processor's cache.
    """
    _, height, width = pictures.shape
    layers = np.empty((len(pictures) - 1, 3, width), np.float32)
    first, last = max(start, INNER), min(stop, height - INNER)
    for v in range(first - 1, last + 1):
        for k in range(len(layers)):
            less, more, out = pictures[k, v], pictures[k + 1, v], layers[k, v % 3]
            for u in range(width):
                out[u] = more[u] - less[u]
        if v > first:
            extrema_of_row(layers, v - 1, least, mask)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def extrema_of_row(layers, v, least, mask):  # type: ignore[no-untyped-def]
    """`extrema` of row v of layers (L, 3, W), whose row i is at i modulo 3."""
    width = layers.shape[2]
    top, low = np.empty(width, np.float32), np.empty(width, np.float32)
    for k in range(1, len(layers) - 1):
        before, here, after = layers[k - 1], layers[k], layers[k + 1]
        above, middle, below = (v - 1) % 3, v % 3, (v + 1) % 3
        a0, a1, a2 = before[above], before[middle], before[below]
        b0, b1, b2 = here[above], here[middle], here[below]
        c0, c1, c2 = after[above], after[middle], after[below]
        for u in range(width):
            high = max(a0[u], a1[u], a2[u], b0[u], b1[u], b2[u], c0[u], c1[u])
            deep = min(a0[u], a1[u], a2[u], b0[u], b1[u], b2[u], c0[u], c1[u])
            top[u], low[u] = max(high, c2[u]), min(deep, c2[u])
        found = mask[k - 1, v]
        for u in range(INNER, width - INNER):
            value = b1[u]
            high = max(top[u - 1], top[u], top[u + 1])
            deep = min(low[u - 1], low[u], low[u + 1])
            found[u] = ((value > least) & (value >= high)) | ((value < -least) & (value <= deep))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def around_pixel(pictures, k, v, u, out):  # type: ignore[no-untyped-def]
    """Write what is around pixel (v, u) of layer k to `out` (3, 3, 3)."""
    for i in range(3):
        for j in range(3):
            for n in range(3):
                row, column = v + j - 1, u + n - 1
                out[i, j, n] = pictures[k + i, row, column] - pictures[k + i - 1, row, column]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refined(pictures, places, least, mask, out):  # type: ignore[no-untyped-def]
    """Keypoints of extrema at `places` (K, 3) = (layer, row, column), written to `out` (K, 4), each once; their count.

    The extremum of a parabola through the neighbours, if it exceeds `least` and is no edge (Brown and Lowe, 2002). Samples
    (P - 3, H, W) at which one was found are marked SETTLED in the mask.
    """
    last, (height, width), count = len(pictures) - 2, pictures.shape[1:], 0
    around = np.empty((3, 3, 3), np.float32)
    d0, d1, d2 = around[0], around[1], around[2]
    for i in range(len(places)):
        k, v, u = places[i, 0], places[i, 1], places[i, 2]
        x, y, s, settled = 0.0, 0.0, 0.0, False
        for _ in range(STEPS):
            around_pixel(pictures, k, v, u, around)
            middle = 2.0 * d1[1, 1]
            gx, gy = (d1[1, 2] - d1[1, 0]) / 2.0, (d1[2, 1] - d1[0, 1]) / 2.0
            gs = (d2[1, 1] - d0[1, 1]) / 2.0
            xx, yy = d1[1, 2] + d1[1, 0] - middle, d1[2, 1] + d1[0, 1] - middle
            ss = d2[1, 1] + d0[1, 1] - middle
            xy = (d1[2, 2] - d1[2, 0] - d1[0, 2] + d1[0, 0]) / 4.0
            xs = (d2[1, 2] - d2[1, 0] - d0[1, 2] + d0[1, 0]) / 4.0
            ys = (d2[2, 1] - d2[0, 1] - d0[2, 1] + d0[0, 1]) / 4.0
            m0, m1, m2 = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy  # the first row of the adjugate
            det = xx * m0 + xy * m1 + xs * m2
            if det == 0.0:
                break
            x = -(m0 * gx + m1 * gy + m2 * gs) / det
            y = -(m1 * gx + (xx * ss - xs * xs) * gy + (xs * xy - xx * ys) * gs) / det
            s = -(m2 * gx + (xs * xy - xx * ys) * gy + (xx * yy - xy * xy) * gs) / det
            if max(abs(x), abs(y), abs(s)) < 0.5:
                settled = True
                break
            if max(abs(x), abs(y), abs(s)) > width:
                break
            u, v, k = u + round(x), v + round(y), k + round(s)
            if not (1 <= k < last and INNER <= u < width - INNER and INNER <= v < height - INNER):
                break
        if not settled or mask[k - 1, v, u] == SETTLED:
            continue
        mask[k - 1, v, u] = SETTLED
        response = abs(d1[1, 1] + 0.5 * (gx * x + gy * y + gs * s))
        trace, flat = xx + yy, xx * yy - xy * xy
        if response < least or flat <= 0 or trace * trace * CURVED >= (CURVED + 1) ** 2 * flat:
            continue
        out[count, 0], out[count, 1], out[count, 2], out[count, 3] = u + x, v + y, k + s, response
        count += 1
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def polar(across, up, fall, magnitudes, turns):  # type: ignore[no-untyped-def]
    """Of gradients (N,), (N,): magnitudes times `fall`, and directions in turns.

    Directions are right to 0.00002 turns (a polynomial, so that a row is one vector operation), counter-clockwise.
    """
    for i in range(len(across)):
        a, b = abs(across[i]), abs(up[i])
        ratio = min(a, b) / max(a, b, TINY)
        square = ratio * ratio
        turn = ratio * (POLYNOMIAL[0] + square * (POLYNOMIAL[1] + square * (POLYNOMIAL[2] + square * POLYNOMIAL[3])))
        turn = QUARTER - turn if b > a else turn
        turn = HALF - turn if across[i] < 0 else turn
        turns[i] = ONE - turn if up[i] < 0 else turn
        magnitudes[i] = fall[i] * math.sqrt(across[i] * across[i] + up[i] * up[i])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bell(radius, deviation):  # type: ignore[no-untyped-def]
    """A Gaussian (2 radius + 1,), 1 in the middle."""
    out = np.empty(2 * radius + 1, np.float32)
    for i in range(radius + 1):
        out[i] = out[2 * radius - i] = math.exp(-((i - radius) ** 2) / (2 * deviation * deviation))
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def orientation(picture, x, y, scale):  # type: ignore[no-untyped-def]
    """The direction (turns) of most gradients around a point, weighted by magnitude and a Gaussian of WIDE scales."""
    height, width = picture.shape
    column, row, radius = round(x), round(y), round(3 * WIDE * scale)
    fall = bell(radius, WIDE * scale)
    across, up = np.empty(2 * radius + 1, np.float32), np.empty(2 * radius + 1, np.float32)
    magnitudes, turns = np.empty_like(across), np.empty_like(across)
    raw = np.zeros(DIRECTIONS + 4, np.float32)
    first, last = max(column - radius, 1), min(column + radius, width - 2) + 1
    for v in range(max(row - radius, 1), min(row + radius, height - 2) + 1):
        above, here, below = picture[v - 1], picture[v], picture[v + 1]
        for i in range(last - first):
            across[i], up[i] = here[first + i + 1] - here[first + i - 1], above[first + i] - below[first + i]
        polar(across[: last - first], up, fall[first - column + radius :], magnitudes, turns)
        level = fall[v - row + radius]
        for i in range(last - first):
            at = int(np.float32(DIRECTIONS) * turns[i] + HALF)
            raw[(at if at < DIRECTIONS else 0) + 2] += level * magnitudes[i]
    raw[0], raw[1] = raw[DIRECTIONS], raw[DIRECTIONS + 1]
    raw[DIRECTIONS + 2], raw[DIRECTIONS + 3] = raw[2], raw[3]
    smooth = np.empty(DIRECTIONS, np.float32)
    for i in range(DIRECTIONS):
        smooth[i] = (raw[i] + raw[i + 4]) / 16 + (raw[i + 1] + raw[i + 3]) / 4 + raw[i + 2] * 0.375
    best = smooth.argmax()
    left, right = smooth[best - 1], smooth[(best + 1) % DIRECTIONS]
    bend = left - 2 * smooth[best] + right
    return ((best + (0.5 * (left - right) / bend if bend != 0 else 0.0)) / DIRECTIONS) % 1.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def between(along, slope, low, high):  # type: ignore[no-untyped-def]
    """The range of whole numbers i from low to below high for which |along + slope i| < EDGE."""
    if abs(slope) < 1e-6:
        return (low, high) if abs(along) < EDGE else (low, low)
    one, other = (-EDGE - along) / slope, (EDGE - along) / slope
    return max(low, math.floor(min(one, other)) + 1), min(high, math.ceil(max(one, other)))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def vector(picture, x, y, scale, turn, out):  # type: ignore[no-untyped-def]
    """The vector (128,) uint8 of a point with a direction (turns): histograms of gradients in 4 x 4 cells, turned with it.

    Every STEP-th pixel of every STEP-th row counts: about four a side of a cell, as Lowe has it.
    """
    height, width = picture.shape
    column, row, side = round(x), round(y), CELL * scale
    radius = round(side * math.sqrt(2) * EDGE) // STEP * STEP
    c, s = math.cos(TURN * turn) / side, -math.sin(TURN * turn) / side
    fall = bell(radius, side * CELLS / 2)
    most = (radius + 1) * (radius + 1)
    across, up, weights = np.empty(most, np.float32), np.empty(most, np.float32), np.empty((2, most), np.float32)
    places = np.empty((2, most), np.int32)
    count = 0
    for dv in range(-radius, radius + 1, STEP):
        if not 1 <= row + dv < height - 1:
            continue
        first, last = between(s * dv, c, max(-radius, 1 - column), min(radius, width - 2 - column) + 1)
        first, last = between(c * dv, -s, first, last)
        first += (first + radius) % STEP
        above, here, below = picture[row + dv - 1], picture[row + dv], picture[row + dv + 1]
        for du in range(first, last, STEP):
            u = column + du
            across[count], up[count] = here[u + 1] - here[u - 1], above[u] - below[u]
            weights[0, count], weights[1, count] = fall[du + radius], fall[dv + radius]
            places[0, count], places[1, count] = du, dv
            count += 1
    cells = np.zeros((CELLS + 2) * (CELLS + 2) * (BINS + 1), np.float32)
    histograms(across[:count], up[:count], weights, places, c, s, np.float32(turn), cells)
    packed(cells, out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def histograms(across, up, weights, places, c, s, turn, cells):  # type: ignore[no-untyped-def]
    """Add gradients (N,), (N,) with weights (2, N) at places (2, N) from a point to its cells, linearly in all three."""
    magnitudes, turns = np.empty_like(across), np.empty_like(across)
    polar(across, up, weights[0], magnitudes, turns)
    shares = np.empty((4, len(across)), np.float32)
    starts = np.empty(len(across), np.int32)
    columns, rows, bins, sums = shares[0], shares[1], shares[2], shares[3]
    dus, dvs, levels = places[0], places[1], weights[1]
    for n in range(len(across)):
        du, dv = float(dus[n]), float(dvs[n])
        p, q = np.float32(c * du + s * dv + EDGE), np.float32(c * dv - s * du + EDGE)
        angle = turns[n] - turn
        angle = np.float32(BINS) * (angle if angle >= 0 else angle + ONE)
        i, j, b = nb.int32(q), nb.int32(p), min(nb.int32(angle), nb.int32(BINS - 1))
        rows[n], columns[n], bins[n] = q - np.float32(i), p - np.float32(j), angle - np.float32(b)
        sums[n] = levels[n] * magnitudes[n]
        starts[n] = (i * nb.int32(CELLS + 2) + j) * nb.int32(BINS + 1) + b
    for n in range(len(across)):
        weight, fi, fj, fb, at = sums[n], rows[n], columns[n], bins[n], np.int64(starts[n])
        lower = weight * fi
        for start, part in ((at, weight - lower), (at + (CELLS + 2) * (BINS + 1), lower)):
            right = part * fj
            left = part - right
            left_up, right_up = left * fb, right * fb
            cells[start] += left - left_up
            cells[start + 1] += left_up
            cells[start + BINS + 1] += right - right_up
            cells[start + BINS + 2] += right_up


@nb.njit(cache=True, nogil=True, error_model="numpy")
def packed(cells, out):  # type: ignore[no-untyped-def]
    """The inner cells, as bytes: of unit length, none above LARGEST, of unit length again."""
    raw = np.empty(CELLS * CELLS * BINS, np.float32)
    at, square = 0, np.float32(0)
    for i in range(1, CELLS + 1):
        for j in range(1, CELLS + 1):
            start = (i * (CELLS + 2) + j) * (BINS + 1)
            cells[start] += cells[start + BINS]
            for b in range(BINS):
                raw[at] = cells[start + b]
                square += raw[at] * raw[at]
                at += 1
    top, square = np.float32(LARGEST * math.sqrt(square)), np.float32(0)
    for k in range(len(raw)):
        raw[k] = min(raw[k], top)
        square += raw[k] * raw[k]
    unit = np.float32(UNIT / max(math.sqrt(square), 1e-12))
    for k in range(len(raw)):
        out[k] = int(min(raw[k] * unit + HALF, np.float32(255)))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def described(pictures, keypoints, sigma, layers, upright, out, start, stop):  # type: ignore[no-untyped-def]
    """Write vectors of the keypoints (K, 4) from start to below stop of one octave's pictures to `out` (K, 128).

    `upright` ones are not turned.
    """
    for i in range(start, stop):
        x, y, layer = keypoints[i, 0], keypoints[i, 1], keypoints[i, 2]
        picture = pictures[round(layer)]
        scale = sigma * 2.0 ** (layer / layers)
        turn = 0.0 if upright else orientation(picture, x, y, scale)
        vector(picture, x, y, scale, turn, out[i])
