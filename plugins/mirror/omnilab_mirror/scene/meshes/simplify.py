"""Mesh simplification for viewers by vertex clustering (Rossignac and Borrel, 1993)."""

from __future__ import annotations

import cv2
import numpy as np

from omnilab.api import Bools, Floats, Ints, Mesh
from omnilab_mirror.scene.meshes.triangles import Triangles

MAX_TRIANGLES = 60_000
FINEST_M = 0.01  # the smallest size of a cluster; it grows until the triangles are few enough
CEILING_M = 2.0  # above the lowest point; what is lower is furniture
MAX_CELLS = 2_000_000  # along a side: the number of all of them fits in 64 bits
SIDE = 64  # pixels of a picture that colours are taken from


def simplified(triangles: Triangles) -> Mesh:
    """At most 60,000 triangles with one colour per vertex, open from above."""
    shown = triangles[~_overhead(triangles)]
    shown = shown if len(shown) else triangles
    area_m2 = shown.twice_areas.sum() / 2
    colors, cell_m = _corner_colors(shown), max(FINEST_M, np.sqrt(area_m2 / MAX_TRIANGLES) / 3)
    while True:
        mesh = _clustered(shown.corners.reshape(-1, 3), colors.reshape(-1, 3), cell_m)
        if len(mesh.triangles) <= MAX_TRIANGLES:
            return mesh
        cell_m *= 1.5


def _overhead(triangles: Triangles) -> Bools:
    """Which triangles (T,) are level and in the top fifth: the ceiling, where there is one."""
    (_, _, low), (_, _, high) = triangles.bounds
    level = np.abs(triangles.normals[:, 2]) > 0.7 * triangles.twice_areas
    lowest_m = max(high - (high - low) / 5, low + CEILING_M)
    return np.asarray(level & (triangles.corners[..., 2].mean(axis=1) > lowest_m))


def _corner_colors(triangles: Triangles) -> Floats:
    """RGB (T, 3, 3) of each corner: its tint times the picture there, halfway to the mean over the triangle."""
    small = [cv2.resize(picture, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for picture in triangles.pictures]
    middle = triangles.uv.mean(axis=1, keepdims=True)
    column, row = np.moveaxis(np.floor((triangles.uv + middle) / 2 % 1 * SIDE).astype(int) % SIDE, -1, 0)
    return np.asarray(np.stack(small)[triangles.picture[:, None], row, column] * (triangles.colors / 255))


def _clustered(points: Floats, colors: Floats, cell_m: float) -> Mesh:
    """Triangles between the means of the points (3 T, 3) in each cell, each once, with the mean colours."""
    extent = points.max(axis=0) - points.min(axis=0)
    cell_m = max(cell_m, float(extent.max()) / MAX_CELLS)
    cells = np.floor((points - points.min(axis=0)) / cell_m).astype(np.int64)
    size = cells.max(axis=0) + 1
    _, cell, count = np.unique(np.ravel_multi_index(cells.T, size.tolist()), return_inverse=True, return_counts=True)
    ids: Ints = np.sort(cell.reshape(-1, 3), axis=1)
    ids = np.unique(ids[(ids[:, 0] != ids[:, 1]) & (ids[:, 1] != ids[:, 2])], axis=0)
    return Mesh(_means(points, cell, count), ids, _means(colors, cell, count).round().astype(np.uint8))


def _means(values: Floats, cell: Ints, count: Ints) -> Floats:
    return np.column_stack([np.bincount(cell, values[:, i]) for i in range(3)]) / count[:, None]
