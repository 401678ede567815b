"""The ray tracer: all rays of an image leave one point, and every face is a parallelogram.

With a face at corner p, edges e1 and e2, seen from O, let r0, r1, r2 be the rows of [p - O, e1, e2]^-1. The ray O + t d
meets the face where w = r0.d > 0 and 0 <= r1.d <= w and 0 <= r2.d <= w, at t = 1 / w: the nearest face has the largest
w. Whole blocks of pixels, and then the tiles in them, first sort out what none of their rays can see: a cone against the
five planes through O that bound a face.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.atlas import Atlas

Array = npt.NDArray[Any]
F = TypeVar("F", bound=Callable[..., Any])
# constants of this file, since numba's cache sees no changes in others
TILE, BLOCK = 8, 32  # pixels
EDGE = 1e-9  # neighbouring faces overlap by this much of 1/m, so that no ray slips between them


def compiled(function: F) -> F:
    """The function as machine code, which is kept beside the module."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def compiled_parallel(function: F) -> F:
    """The same, with `prange` over all of numba's threads."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)(function))


class Cones(NamedTuple):
    """A cone around the rays of each of (V, U) squares of pixels."""

    axis: Array  # (V, U, 3)
    spread: Array  # (V, U, 2): cosine and sine of the angle to the axis that no ray exceeds


class View(NamedTuple):
    """F faces as seen from N viewpoints, in the camera's frame."""

    rows: Array  # (N, F, 9): r0, r1, r2
    planes: Array  # (N, F, 5, 3): inward unit normals of the planes through O that bound the face; r0's first
    reach: Array  # (N, F): the length of r0
    density: Array  # (N, F): texels of the finest level over |det|; with the solid angle and w it gives the level


def view_from(T_world_camera: Array, corner: Array, edges: Array, texels: Array) -> View:
    """Faces with corners (F, 3), edges (F, 2, 3) and `texels` (F,) as seen from poses (N, 4, 4)."""
    p = corner - T_world_camera[:, None, :3, 3]
    e1, e2 = np.broadcast_to(edges[:, 0], p.shape), np.broadcast_to(edges[:, 1], p.shape)
    normal = np.cross(edges[:, 0], edges[:, 1])
    det = np.einsum("nfi,fi->nf", p, normal)
    edge_on = np.abs(det) < 1e-12  # the viewpoint lies in the face's plane
    inverse = np.where(edge_on, 0.0, 1 / np.where(edge_on, 1.0, det))
    rows = np.stack([np.broadcast_to(normal, p.shape), np.cross(e2, p), np.cross(p, e1)], 2) * inverse[..., None, None]
    rows = rows @ T_world_camera[:, None, :3, :3]
    r0, r1, r2 = rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]
    planes = np.stack([r0, r1, r0 - r1, r2, r0 - r2], 2)
    length = np.linalg.norm(planes, axis=-1)
    planes = planes / np.maximum(length, 1e-300)[..., None]
    rows = rows.reshape(*det.shape, 9)
    return View(*map(np.ascontiguousarray, (rows, planes, length[..., 0], texels * np.abs(inverse))))


@compiled
def dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@compiled
def sift(
    axis: Array, spread: Array, planes: Array, reach: Array, among: Array, number: int, chosen: Array, limit: Array
) -> int:
    """Which of the first `number` faces of `among` a cone may see: how many they are.

    They go to `chosen`, nearest first, and the largest w that each can have to `limit`.
    """
    cos, sin = spread[0], spread[1]
    count = 0
    behind = 0.0  # some face fills the cone at this w or more: what stays below is hidden
    for n in range(number):
        f = among[n]
        inside = 1.0
        for side in range(4, -1, -1):
            inside = min(inside, dot(planes[f, side], axis))
            if inside < -sin:
                break
        if inside < -sin:
            continue
        c = dot(planes[f, 0], axis)
        s = math.sqrt(max(0.0, 1 - c * c))
        most = reach[f] * (1.0 if c >= cos else c * cos + s * sin)
        if most <= behind:
            continue
        if inside > sin:
            behind = max(behind, reach[f] * (c * cos - s * sin) * (1 - 1e-9))
        k = count
        while k > 0 and limit[k - 1] < most:
            chosen[k], limit[k] = chosen[k - 1], limit[k - 1]
            k -= 1
        chosen[k], limit[k] = f, most
        count += 1
    while count > 0 and limit[count - 1] < behind:
        count -= 1
    return count


@compiled
def nearest(x: float, y: float, z: float, rows: Array, limit: Array, count: int) -> tuple[int, float, float, float]:
    """Which of `count` faces (C, 9) a ray meets first (-1: none), how far away, and where: fractions of its edges."""
    hit, best, b1, b2 = -1, 0.0, 0.0, 0.0
    for k in range(count):
        if limit[k] <= best:
            break
        w = rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z
        if w > best:
            a1 = rows[k, 3] * x + rows[k, 4] * y + rows[k, 5] * z
            a2 = rows[k, 6] * x + rows[k, 7] * y + rows[k, 8] * z
            if -EDGE <= a1 <= w + EDGE and -EDGE <= a2 <= w + EDGE:
                hit, best, b1, b2 = k, w, a1, a2
    t = 1 / best
    return hit, t, b1 * t, b2 * t


@compiled
def add_texel(texels: Array, start: int, width: int, height: int, x: float, y: float, total: Array) -> None:
    """Add to `total` (C,) the bilinear colour at fractions (x, y) of the picture that begins at `start`."""
    px = min(max(x * width - 0.5, 0.0), width - 1.0)
    py = min(max(y * height - 0.5, 0.0), height - 1.0)
    x0, y0 = int(px), int(py)
    fx, fy = px - x0, py - y0
    a = start + y0 * width + x0
    b = a + (width if y0 + 1 < height else 0)
    right = 1 if x0 + 1 < width else 0
    for channel in range(len(total)):
        low = texels[a, channel] * (1 - fx) + texels[a + right, channel] * fx
        high = texels[b, channel] * (1 - fx) + texels[b + right, channel] * fx
        total[channel] += low * (1 - fy) + high * fy


@compiled
def shade(
    rays: Array, rows: Array, limit: Array, chosen: Array, count: int, density: Array, atlas: Atlas, out: Array
) -> None:
    """Fill the pixels `out` (h, w, C) of a tile with the means over its `rays` (h, w, S, 4)."""
    height, width, samples, _ = rays.shape
    total = np.empty(out.shape[2], np.float64)
    for v in range(height):
        for u in range(width):
            total[:] = 0
            for s in range(samples):
                k, t, x, y = nearest(rays[v, u, s, 0], rays[v, u, s, 1], rays[v, u, s, 2], rows, limit, count)
                if k >= 0:
                    f = chosen[k]
                    # the pixel covers solid_angle t^2 / cos on the face: 4^level texels
                    _, exponent = math.frexp(rays[v, u, s, 3] * density[f] * (t * t * t))
                    level = min(atlas.first[f] + max(exponent >> 1, 0), atlas.first[f + 1] - 1)
                    add_texel(
                        atlas.texels,
                        atlas.levels[level, 0],
                        atlas.levels[level, 1],
                        atlas.levels[level, 2],
                        x,
                        y,
                        total,
                    )
            for channel in range(len(total)):
                out[v, u, channel] = np.uint8(total[channel] / (256 * samples) + 0.5)


@compiled_parallel
def trace(rays: Array, blocks: Cones, tiles: Cones, view: View, atlas: Atlas, out: Array) -> None:
    """Fill the images `out` (N, H, W, C). Each pixel is computed alone, so the number of threads changes nothing."""
    height, width = rays.shape[:2]
    blocks_v, blocks_u = blocks.axis.shape[:2]
    faces = view.reach.shape[1]
    for job in numba.prange(len(out) * blocks_v):
        i, bv = job // blocks_v, job % blocks_v
        planes, reach, all_rows, density = view.planes[i], view.reach[i], view.rows[i], view.density[i]
        everything = np.arange(faces)
        some, few, limit, rows = (
            np.empty(faces, np.int64),
            np.empty(faces, np.int64),
            np.empty(faces),
            np.empty((faces, 9)),
        )
        for bu in range(blocks_u):
            number = sift(blocks.axis[bv, bu], blocks.spread[bv, bu], planes, reach, everything, faces, some, limit)
            for v in range(bv * BLOCK, min(bv * BLOCK + BLOCK, height), TILE):
                for u in range(bu * BLOCK, min(bu * BLOCK + BLOCK, width), TILE):
                    tv, tu = v // TILE, u // TILE
                    count = sift(tiles.axis[tv, tu], tiles.spread[tv, tu], planes, reach, some, number, few, limit)
                    for k in range(count):
                        rows[k] = all_rows[few[k]]
                    tile = slice(v, min(v + TILE, height)), slice(u, min(u + TILE, width))
                    shade(rays[tile], rows, limit, few, count, density, atlas, out[i][tile])
