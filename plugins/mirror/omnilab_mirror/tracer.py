"""The ray tracer: all rays of an image leave one point, and every face is a parallelogram.

With a face at corner p, edges e1 and e2, seen from O, let r0, r1, r2 be the rows of [p - O, e1, e2]^-1. The ray O + t d
meets the face where w = r0.d > 0 and 0 <= r1.d <= w and 0 <= r2.d <= w, at t = 1 / w: the nearest face has the largest
w. Whole tiles of pixels first sort out, cone against the five planes through O that bound a face, what none of them sees.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
F = TypeVar("F", bound=Callable[..., Any])
TILE = 8  # pixels; a constant of this file, since numba's cache sees no changes in others
EDGE = 1e-9  # neighbouring faces overlap by this much of 1/m, so that no ray slips between them


def compiled(function: F) -> F:
    """The function as machine code, which is kept beside the module."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(function))


def compiled_parallel(function: F) -> F:
    """The same, with `prange` over all of numba's threads."""
    return cast(
        "F", numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, parallel=True)(function)
    )


class View(NamedTuple):
    """F faces as seen from N viewpoints, in the camera's frame."""

    rows: Array  # (N, F, 3, 3): r0, r1, r2
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
    return View(*map(np.ascontiguousarray, (rows, planes, length[..., 0], texels * np.abs(inverse))))


@compiled
def dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@compiled
def seen(axis: Array, spread: Array, planes: Array, reach: Array, chosen: Array, limit: Array) -> int:
    """Fill `chosen` with the faces a tile may see, nearest first, and `limit` with each one's largest w; their number."""
    cos, sin = spread[0], spread[1]
    count = 0
    behind = 0.0  # some face fills the tile at this w or more: what stays below is hidden
    for f in range(len(reach)):
        least = 1.0
        for side in range(4, -1, -1):
            least = min(least, dot(planes[f, side], axis))
            if least < -sin:
                break
        if least < -sin:
            continue
        c = dot(planes[f, 0], axis)
        s = math.sqrt(max(0.0, 1 - c * c))
        most = reach[f] * (1.0 if c >= cos else c * cos + s * sin)
        if most <= behind:
            continue
        if least > sin:
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
def nearest(ray: Array, rows: Array, limit: Array, count: int) -> tuple[int, float, float, float]:
    """Which of `count` faces (C, 9) a ray meets first (-1: none), how far away, and where on it: fractions of its edges."""
    x, y, z = ray[0], ray[1], ray[2]
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
    """Add to `total` (C,) the bilinear colour at fractions (x, y) of a picture stored at `start`."""
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


@compiled_parallel
def trace(
    rays: Array, axis: Array, spread: Array, view: View, first: Array, levels: Array, texels: Array, out: Array
) -> None:
    """Fill the images `out` (N, H, W, C). Each pixel is computed alone, so the threads' number changes nothing.

    `levels` (L, 3) lists start, width and height of every picture in `texels` (T, C), in 1/256 grey levels; those of
    face f are the lines first[f] to first[f + 1], finest first.
    """
    height, width, samples, _ = rays.shape
    tiles_v, tiles_u, _ = axis.shape
    faces = len(first) - 1
    for job in numba.prange(len(out) * tiles_v):
        i, tv = job // tiles_v, job % tiles_v
        chosen, limit = np.empty(faces, np.int64), np.empty(faces, np.float64)
        rows = np.empty((faces, 9))
        total = np.empty(out.shape[3], np.float64)
        for tu in range(tiles_u):
            count = seen(axis[tv, tu], spread[tv, tu], view.planes[i], view.reach[i], chosen, limit)
            for k in range(count):
                for c in range(9):
                    rows[k, c] = view.rows[i, chosen[k], c // 3, c % 3]
            for v in range(tv * TILE, min(tv * TILE + TILE, height)):
                for u in range(tu * TILE, min(tu * TILE + TILE, width)):
                    total[:] = 0
                    for s in range(samples):
                        ray = rays[v, u, s]
                        k, t, x, y = nearest(ray, rows, limit, count)
                        if k >= 0:
                            f = chosen[k]
                            # the pixel covers solid_angle t^2 / cos on the face: 4^level texels
                            _, exponent = math.frexp(ray[3] * view.density[i, f] * (t * t * t))
                            line = min(first[f] + max(exponent >> 1, 0), first[f + 1] - 1)
                            start, columns, lines = levels[line]
                            add_texel(texels, start, columns, lines, x, y, total)
                    for channel in range(len(total)):
                        out[i, v, u, channel] = np.uint8(total[channel] / (256 * samples) + 0.5)
