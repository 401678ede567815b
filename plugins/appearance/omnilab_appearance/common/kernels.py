"""Numba kernels of descriptors, distances and altimeters; sums run in one fixed order for any number of threads."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def line_sums(padded, cos, sin, center):  # type: ignore[no-untyped-def]
    """Radon transform: sums (M, n, N) of bilinear samples along lines of images (n + 4, n + 4, N), two zeros around them."""
    n = padded.shape[0] - 4
    batch = padded.shape[2]
    out = np.zeros((len(cos), n, batch), np.float32)
    for m in nb.prange(len(cos)):
        for i in range(n):
            d = i - center
            reach = math.sqrt(max(0.0, (n / 2) ** 2 - d * d)) + 2.0  # half the chord, and what bilinear samples touch
            first = max(0, int(center - reach))
            last = min(n - 1, int(center + reach) + 1)
            total = out[m, i]
            for j in range(first, last + 1):
                t = j - center
                x = center + d * cos[m] + t * sin[m] + 2.0
                y = center - d * sin[m] + t * cos[m] + 2.0
                if x < 0.0 or y < 0.0 or x >= n + 3 or y >= n + 3:
                    continue
                c, r = int(x), int(y)
                u, v = x - c, y - r
                w00 = np.float32((1 - u) * (1 - v))
                w01 = np.float32(u * (1 - v))
                w10 = np.float32((1 - u) * v)
                w11 = np.float32(u * v)
                p00, p01, p10, p11 = padded[r, c], padded[r, c + 1], padded[r + 1, c], padded[r + 1, c + 1]
                for b in range(batch):
                    total[b] += w00 * p00[b] + w01 * p01[b] + w10 * p10[b] + w11 * p11[b]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def line_sums_of_one(padded, cos, sin, center, out, start, stop):  # type: ignore[no-untyped-def]
    """`line_sums` of one image (n + 4, n + 4), written to `out` (M, n) for the directions from start to below stop.

    To the last bit: without a loop over images it takes 0.7 of the time.
    """
    n, width = padded.shape[0] - 4, padded.shape[1]
    pixels = padded.ravel()
    for m in range(start, stop):
        for i in range(n):
            d = i - center
            reach = math.sqrt(max(0.0, (n / 2) ** 2 - d * d)) + 2.0
            total = np.float32(0)
            for j in range(max(0, int(center - reach)), min(n - 1, int(center + reach) + 1) + 1):
                t = j - center
                x = center + d * cos[m] + t * sin[m] + 2.0
                y = center - d * sin[m] + t * cos[m] + 2.0
                if x < 0.0 or y < 0.0 or x >= n + 3 or y >= n + 3:
                    continue
                c, r = nb.int32(x), nb.int32(y)
                u, v = x - c, y - r
                w00 = np.float32((1 - u) * (1 - v))
                w01 = np.float32(u * (1 - v))
                w10 = np.float32((1 - u) * v)
                w11 = np.float32(u * v)
                k = r * width + c
                total += w00 * pixels[k] + w01 * pixels[k + 1] + w10 * pixels[k + width] + w11 * pixels[k + width + 1]
            out[m, i] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def line_samples(n, cos, sin, center):  # type: ignore[no-untyped-def]
    """What `line_sums` reads of an image (n + 4, n + 4), and how much of it.

    Pixels (M, S) of the image in one row, each the upper left of four; their weights (M, S, 4); where line i of a direction
    starts among its samples (n + 1,). Beyond the zeros around an image lies a zero.
    """
    starts, edge = np.zeros(n + 1, np.int64), n + 2.5
    for i in range(n):
        reach = math.sqrt(max(0.0, (n / 2) ** 2 - (i - center) ** 2)) + 2.0
        starts[i + 1] = starts[i] + min(n - 1, int(center + reach) + 1) + 1 - max(0, int(center - reach))
    pixels = np.empty((len(cos), starts[n]), np.int32)
    weights = np.empty((len(cos), starts[n], 4), np.float32)
    for m in range(len(cos)):
        for i in range(n):
            d = i - center
            reach = math.sqrt(max(0.0, (n / 2) ** 2 - d * d)) + 2.0
            t = max(0, int(center - reach)) - center
            for k in range(starts[i], starts[i + 1]):
                x = min(max(center + d * cos[m] + t * sin[m] + 2.0, 0.0), edge)
                y = min(max(center - d * sin[m] + t * cos[m] + 2.0, 0.0), edge)
                c, r = int(x), int(y)
                u, v = x - c, y - r
                pixels[m, k] = r * (n + 4) + c
                weights[m, k, 0], weights[m, k, 1] = (1 - u) * (1 - v), u * (1 - v)
                weights[m, k, 2], weights[m, k, 3] = (1 - u) * v, u * v
                t += 1
    return pixels, weights, starts


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sampled_line_sums(image, pixels, weights, starts, out):  # type: ignore[no-untyped-def]
    """`line_sums` of one image (n + 4, n + 4) by its `line_samples`, written to `out` (M, n). To the last bit."""
    flat, below = image.ravel(), np.uint64(image.shape[1])
    one = np.uint64(1)
    for m in range(len(out)):
        for i in range(out.shape[1]):
            total = np.float32(0)
            for k in range(starts[i], starts[i + 1]):
                at, w = np.uint64(pixels[m, k]), weights[m, k]
                total += (
                    w[0] * flat[at] + w[1] * flat[at + one] + w[2] * flat[at + below] + w[3] * flat[at + below + one]
                )
            out[m, i] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cell_averages(columns, at, weights, starts, lanes, out):  # type: ignore[no-untyped-def]
    """Averages (n, n) over the cells of a square image, given by its columns (S, S + lanes), `lanes` of them for nothing.

    Cell i of either axis holds the pixels at[starts[i]] to below at[starts[i + 1]], with their weights; `lanes` at most.
    Sums along rows come first, in the order of OpenCV's INTER_AREA: all rows of a cell at once.
    """
    sums = np.empty(lanes, np.float32)
    for i in range(len(out)):
        first, top = starts[i], at[starts[i]]
        for j in range(len(out)):
            left = at[starts[j]]
            for r in range(lanes):
                sums[r] = 0
            for k in range(starts[j + 1] - starts[j]):
                pixels, weight = columns[left + k, top : top + lanes], weights[starts[j] + k]
                for r in range(lanes):
                    sums[r] += np.float32(pixels[r]) * weight
            total = weights[first] * sums[0]
            for r in range(1, starts[i + 1] - first):
                total += weights[first + r] * sums[r]
            out[i, j] = total


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def power_sums(queries, places, weights, p):  # type: ignore[no-untyped-def]
    """Sums (Q, P) of weights (D,) times |difference|^p between queries (Q, D) and places (P, D)."""
    out = np.empty((len(queries), len(places)), np.float32)
    for j in nb.prange(len(places)):
        for i in range(len(queries)):
            total = 0.0
            for d in range(len(weights)):
                apart = abs(queries[i, d] - places[j, d])
                power = apart
                for _ in range(p - 1):
                    power *= apart
                total += weights[d] * power
            out[i, j] = total
    return out


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def contrast_sums(queries, places):  # type: ignore[no-untyped-def]
    """Sums (Q, P) of the squared contrasts (r - s) / (r + s) between queries (Q, D) and places (P, D)."""
    out = np.empty((len(queries), len(places)), np.float32)
    for j in nb.prange(len(places)):
        for i in range(len(queries)):
            total = 0.0
            for d in range(queries.shape[1]):
                both = queries[i, d] + places[j, d]
                if both != 0:
                    contrast = (queries[i, d] - places[j, d]) / both
                    total += contrast * contrast
            out[i, j] = total
    return out


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gradient_histograms(images, rows, columns):  # type: ignore[no-untyped-def]
    """`gradient_histograms_of_one` of images (N, H, W), written to (N, H, bins) and (N, W, bins)."""
    for n in nb.prange(len(images)):
        gradient_histograms_of_one(images[n], rows[n], columns[n])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gradient_histograms_of_one(image, rows, columns):  # type: ignore[no-untyped-def]
    """Add gradients to histograms of rows (H, bins) and of columns (W, bins), weighted by magnitude; columns wrap."""
    (height, width), bins = image.shape, rows.shape[1]
    cos = np.cos(np.pi * np.arange(1, bins) / bins)
    sin = np.sin(np.pi * np.arange(1, bins) / bins)
    for v in range(height):
        inner = 0 < v < height - 1
        for u in range(width):
            left = u - 1 if u > 0 else width - 1
            right = u + 1 if u + 1 < width else 0
            across = float(image[v, right]) - image[v, left]
            down = float(image[v + 1, u]) - image[v - 1, u] if inner else 0.0
            strength = math.sqrt(across * across + down * down)
            if down < 0 or (down == 0 and across < 0):  # directions count modulo half a turn
                across, down = -across, -down
            k = 0
            for edge in range(bins - 1):
                if cos[edge] * down - sin[edge] * across >= 0 and strength > 0:
                    k += 1
            rows[v, k] += strength
            columns[u, k] += strength


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gradient_cells(images, bins, turn, edges):  # type: ignore[no-untyped-def]
    """Gradient histograms (N, bins, cells, W) of columns within horizontal cells, weighted by magnitude; columns wrap.

    Cell k holds the rows edges[k] to edges[k + 1]; directions count modulo `turn` radians. Means over a cell's rows.
    """
    count, height, width = images.shape
    out = np.zeros((count, bins, len(edges) - 1, width), np.float32)
    for n in nb.prange(count):
        image = images[n]
        for k in range(len(edges) - 1):
            share = 1 / (edges[k + 1] - edges[k])
            for v in range(edges[k], edges[k + 1]):
                inner = 0 < v < height - 1
                for u in range(width):
                    left = u - 1 if u > 0 else width - 1
                    right = u + 1 if u + 1 < width else 0
                    across = float(image[v, right]) - image[v, left]
                    down = float(image[v + 1, u]) - image[v - 1, u] if inner else 0.0
                    strength = math.sqrt(across * across + down * down)
                    b = int((math.atan2(down, across) % turn) * bins / turn)
                    out[n, min(b, bins - 1), k, u] += strength * share
    return out


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def path_sums(rows, first, second, weights):  # type: ignore[no-untyped-def]
    """Sums (P, S) over paths through a matrix of rows (A, B, S): at (first, second), each (P, n), times weights (P, n).

    Between the rows the four around are interpolated; paths must keep within [0, A - 1] and [0, B - 1].
    """
    out = np.zeros((first.shape[0], rows.shape[2]), np.float32)
    for p in nb.prange(first.shape[0]):
        total = out[p]
        for i in range(first.shape[1]):
            weight = weights[p, i]
            if weight == 0:
                continue
            a, b = min(int(first[p, i]), rows.shape[0] - 2), min(int(second[p, i]), rows.shape[1] - 2)
            u, v = first[p, i] - a, second[p, i] - b
            w00 = weight * np.float32((1 - u) * (1 - v))
            w01 = weight * np.float32((1 - u) * v)
            w10 = weight * np.float32(u * (1 - v))
            w11 = weight * np.float32(u * v)
            p00, p01, p10, p11 = rows[a, b], rows[a, b + 1], rows[a + 1, b], rows[a + 1, b + 1]
            for s in range(rows.shape[2]):
                total[s] += w00 * p00[s] + w01 * p01[s] + w10 * p10[s] + w11 * p11[s]
    return out


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def compressed_distances(still, squeezed, count):  # type: ignore[no-untyped-def]
    """Distances (N, count) between the middles of N matrices (N, R, M), or one, and N others or one compressed by 2a rows.

    Each row of either is divided by its largest value (0 where that is 0); a = 0, 1, ... (Berenguer, thesis, eq. 5.5-5.9).
    """
    n, m = still.shape[1:]
    pairs = max(len(still), len(squeezed))
    scaled = np.empty_like(still)
    for j in nb.prange(len(still) * n):
        row = still[j // n, j % n]
        top = row.max()
        scaled[j // n, j % n] = row * (np.float32(1) / top if top > 0 else np.float32(0))
    out = np.empty((pairs, count))
    for k in nb.prange(pairs * count):
        pair, a = k // count, k % count
        first = scaled[pair if len(still) > 1 else 0]
        second = squeezed[pair if len(squeezed) > 1 else 0]
        rows = n - 2 * a
        apart = np.zeros(m, np.float32)
        between = np.empty(m, np.float32)
        for j in range(rows):
            at = (j + 1) * n / rows - 1
            low = min(int(at), n - 2)
            share = np.float32(at - low)
            top = np.float32(0)
            for i in range(m):
                between[i] = second[low, i] + share * (second[low + 1, i] - second[low, i])
            for i in range(m):
                top = max(top, between[i])
            scale = np.float32(1) / top if top > 0 else np.float32(0)
            for i in range(m):
                apart[i] += abs(first[j + a, i] - between[i] * scale)
        out[pair, a] = apart.sum() / (m * rows)
    return out
