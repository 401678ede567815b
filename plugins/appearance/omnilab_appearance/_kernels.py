"""Inner loops, compiled on first use. Every output is summed in one fixed order, whatever the number of threads."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def line_sums(padded, cos, sin, center):  # type: ignore[no-untyped-def]
    """Sums (M, n, N) of bilinear samples along the lines of images (n + 4, n + 4, N) with a frame of two zeros."""
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
def gradient_histograms(pictures, bins):  # type: ignore[no-untyped-def]
    """Sums of gradient strength by direction over rows (N, H, bins) and over columns (N, bins, W); columns wrap."""
    count, height, width = pictures.shape
    rows = np.zeros((count, height, bins), np.float32)
    columns = np.zeros((count, width, bins), np.float32)
    cos = np.cos(np.pi * np.arange(1, bins) / bins)
    sin = np.sin(np.pi * np.arange(1, bins) / bins)
    for n in nb.prange(count):
        picture = pictures[n]
        for v in range(height):
            inner = 0 < v < height - 1
            for u in range(width):
                left = u - 1 if u > 0 else width - 1
                right = u + 1 if u + 1 < width else 0
                across = float(picture[v, right]) - picture[v, left]
                down = float(picture[v + 1, u]) - picture[v - 1, u] if inner else 0.0
                strength = math.sqrt(across * across + down * down)
                if down < 0 or (down == 0 and across < 0):  # directions count modulo half a turn
                    across, down = -across, -down
                k = 0
                for edge in range(bins - 1):
                    if cos[edge] * down - sin[edge] * across >= 0 and strength > 0:
                        k += 1
                rows[n, v, k] += strength
                columns[n, u, k] += strength
    return rows, columns.transpose(0, 2, 1)
