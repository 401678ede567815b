"""Loops over the corners of millions of triangles: each as numpy would compute it, bit for bit, without arrays in between."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled

Array = npt.NDArray[Any]
PADDING = 1  # numbers behind the last corner: Embree reads four at once
AT_ONCE = 100_000  # triangles


def padded(shape: tuple[int, ...]) -> Array:
    """Room for corners, float32, that Embree reads where they are."""
    numbers = np.empty(math.prod(shape) + PADDING, np.float32)
    numbers[-PADDING:] = 0
    return numbers[:-PADDING].reshape(shape)


def is_padded(corners: Array) -> bool:
    """Whether Embree can read corners where they are."""
    base = corners
    while isinstance(base.base, np.ndarray):
        base = base.base
    behind = base.ctypes.data + base.nbytes - corners.ctypes.data - corners.nbytes
    whole = corners.dtype == np.float32 and corners.flags.c_contiguous and base.flags.c_contiguous
    return bool(whole and behind >= PADDING * corners.itemsize)


def placed(points: Array, index: Array, origin: Array) -> Array:
    """Corners (T, 3, 3) float32: the points (V, 3) float64 with the indices (T, 3), less an origin (3,)."""
    corners = padded((len(index), 3, 3))
    place(points, np.ascontiguousarray(index), origin, corners)
    return corners


def moved(corners: Array, matrix: Array, at: Array) -> Array:
    """Corners (T, 3, 3) whose points x become matrix @ x + at, computed in 64 bits."""
    out = padded(corners.shape)
    if (np.count_nonzero(matrix, axis=1) == 1).all():  # axes are exchanged and scaled, which is exact in any order
        axis = np.argmax(matrix != 0, axis=1)
        exchange(corners, axis, matrix[np.arange(3), axis], at, out)
        return out
    for first in range(0, len(corners), AT_ONCE):
        out[first : first + AT_ONCE] = corners[first : first + AT_ONCE] @ matrix.T + at
    return out


def normals_of(corners: Array) -> tuple[Array, Array]:
    """Normals (T, 3), twice the area long, by the right hand around the corners, and their lengths (T,)."""
    normals, lengths = np.empty((len(corners), 3), corners.dtype), np.empty(len(corners), corners.dtype)
    cross(corners, normals, lengths)
    return normals, lengths


@compiled
def place(points: Array, index: Array, origin: Array, out: Array) -> None:
    for t in range(len(index)):
        for k in range(3):
            v = index[t, k]
            for i in range(3):
                out[t, k, i] = points[v, i] - origin[i]


@compiled
def rows_at(values: Array, index: Array, out: Array) -> None:
    """Fill `out` (T, 3, 3) with the rows of `values` (V, 3) that have the indices (T, 3)."""
    for t in range(len(index)):
        for k in range(3):
            v = index[t, k]
            for i in range(3):
                out[t, k, i] = values[v, i]


@compiled
def exchange(corners: Array, axis: Array, factor: Array, at: Array, out: Array) -> None:
    for t in range(len(corners)):
        for k in range(3):
            for i in range(3):
                out[t, k, i] = (corners[t, k, axis[i]] * factor[i] + 0.0) + at[i]  # no -0, as of a product of matrices


@compiled
def cross(corners: Array, normals: Array, lengths: Array) -> None:
    for t in range(len(corners)):
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        x0, y0, z0, x1, y1, z1 = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
        normals[t, 0], normals[t, 1], normals[t, 2] = x, y, z
        lengths[t] = math.sqrt(x * x + y * y + z * z)


@compiled
def extent(corners: Array) -> tuple[Array, bool]:
    """Lowest and highest corner (2, 3), and whether all are finite."""
    found = np.empty((2, 3))
    found[0], found[1] = math.inf, -math.inf
    finite = True
    for t in range(len(corners)):
        for k in range(3):
            for i in range(3):
                value = corners[t, k, i]
                finite &= math.isfinite(value)
                found[0, i], found[1, i] = min(found[0, i], value), max(found[1, i], value)
    return found, finite
