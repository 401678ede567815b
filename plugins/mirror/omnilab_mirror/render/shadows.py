"""Shadows: how much of each lamp's light reaches the quads, by rays from points on them to points of the lamps.

A block of points tests only the quads that may stand between it and a lamp: those whose bounding sphere touches the
beam between the two, and whose plane does not have both on the same side.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled, compiled_parallel
from omnilab_mirror.render.tracer import dot
from omnilab_mirror.scene.quads import Quad

Array = npt.NDArray[Any]
BLOCK = 8  # points of a block's side
LIFT_M = 0.012  # rays start this far before a quad: carpets and pictures lie nearer to theirs, and cast no shadow


class Blockers(NamedTuple):
    """The F quads as a ray meets them."""

    corner: Array  # (F, 3)
    normal: Array  # (F, 3), unit
    planes: (
        Array  # (F, 3, 4): a, a.corner for a = normal and the duals of u and v, whose products are fractions of them
    )
    middle: Array  # (F, 3) of the bounding sphere
    radius: Array  # (F,), negative where a quad lets light through


def lamplight(quads: list[Quad], lamps: Array, first: Array, spacing_m: float, shadows: bool) -> list[Array]:
    """The lamps' light (rows, columns) on each quad. Rows of `lamps` are x, y, z, power and reach of a point.

    Lamp i consists of the points `first[i]` to `first[i + 1]`.
    """
    corner, u, v = (np.array([getattr(quad, part) for quad in quads]) for part in ("corner", "u", "v"))
    glows = np.array([quad.paint.glows for quad in quads])
    shape = np.maximum(1, np.ceil(np.stack([_length(v), _length(u)], 1) / spacing_m - 1e-6)).astype(np.int64)
    shape[glows] = 1
    start = np.cumsum([0, *shape.prod(axis=1)])
    rows = np.where(glows | (len(lamps) == 0), 0, -(-shape[:, 0] // BLOCK))
    quad_of = np.repeat(np.arange(len(quads)), rows)
    jobs = np.stack([quad_of, np.arange(len(quad_of)) - np.repeat(np.cumsum(rows) - rows, rows)], 1)
    out = np.zeros(start[-1])
    steps = np.stack([u / shape[:, 1:], v / shape[:, :1]], 1)
    blockers = _blockers(corner, u, v, ~glows & shadows)
    light_up(jobs, shape, start, steps, blockers, lamps, first, _spheres(lamps, first), out)
    return [out[a:b].reshape(size) for a, b, size in zip(start, start[1:], shape, strict=False)]


def _blockers(corner: Array, u: Array, v: Array, blocks: Array) -> Blockers:
    normal = np.cross(u, v)
    area2 = (normal**2).sum(1, keepdims=True)
    unit = normal / np.sqrt(area2)
    across = np.stack([unit, np.cross(v, normal) / area2, np.cross(normal, u) / area2], 1)
    planes = np.concatenate([across, np.einsum("fki,fi->fk", across, corner)[..., None]], 2)
    radius = np.maximum(_length(u + v), _length(u - v)) / 2
    return Blockers(corner, unit, planes, corner + (u + v) / 2, np.where(blocks, radius, -1.0))


def _spheres(lamps: Array, first: Array) -> Array:
    """Middle and radius (L, 4) of the points of each lamp."""
    points = [lamps[a:b, :3] for a, b in pairwise(first)]
    spheres = [(*p.mean(axis=0), _length(p - p.mean(axis=0)).max()) for p in points]
    return np.array(spheres).reshape(-1, 4)


def _length(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


@compiled
def beam_distance2(x: float, y: float, z: float, beam: Array) -> float:
    """Square of the distance from a point (relative to the beam's start) to the beam (3,)."""
    along = (x * beam[0] + y * beam[1] + z * beam[2]) / max(beam[0] ** 2 + beam[1] ** 2 + beam[2] ** 2, 1e-18)
    t = min(1.0, max(0.0, along))
    x, y, z = x - t * beam[0], y - t * beam[1], z - t * beam[2]
    return x * x + y * y + z * z


@compiled
def between(corners: Array, lamp: Array, thick: float, own: int, blockers: Blockers, chosen: Array) -> int:
    """How many quads may stand between a block with `corners` (4, 3) and a lamp of radius `thick`; they go to `chosen`."""
    middle, beam, wide2 = np.empty(3), np.empty(3), thick * thick
    for axis in range(3):
        middle[axis] = (corners[0, axis] + corners[3, axis]) / 2
        beam[axis] = lamp[axis] - middle[axis]
    for k in range(4):
        x, y, z = corners[k, 0] - middle[0], corners[k, 1] - middle[1], corners[k, 2] - middle[2]
        wide2 = max(wide2, x * x + y * y + z * z)
    wide, count = math.sqrt(wide2), 0
    for f in range(len(blockers.radius)):
        m = blockers.middle[f]
        near2 = (blockers.radius[f] + wide) ** 2
        if (
            f == own
            or blockers.radius[f] < 0
            or beam_distance2(m[0] - middle[0], m[1] - middle[1], m[2] - middle[2], beam) > near2
        ):
            continue
        plane = blockers.planes[f, 0]
        far = dot(plane, lamp) - plane[3]
        low, high = math.inf, -math.inf
        for k in range(4):
            near = dot(plane, corners[k]) - plane[3]
            low, high = min(low, near), max(high, near)
        if (low > 0 and far > thick) or (high < 0 and far < -thick):
            continue
        chosen[count] = f
        count += 1
    return count


@compiled
def blocked(x: float, y: float, z: float, dx: float, dy: float, dz: float, f: int, planes: Array) -> bool:
    """Whether quad f lies between (x, y, z) and (x + dx, y + dy, z + dz)."""
    n = planes[f, 0]
    slope = n[0] * dx + n[1] * dy + n[2] * dz
    before = n[3] - (n[0] * x + n[1] * y + n[2] * z)
    if not 0 < before * slope < slope * slope:
        return False
    t = before / slope
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    a, b = planes[f, 1], planes[f, 2]
    return bool(0 <= a[0] * x + a[1] * y + a[2] * z - a[3] <= 1 and 0 <= b[0] * x + b[1] * y + b[2] * z - b[3] <= 1)


@compiled
def received(point: Array, normal: Array, lamps: Array, planes: Array, chosen: Array, count: int) -> float:
    """What a point on a quad receives from the points of one lamp (Lambert's cosine law)."""
    total, last = 0.0, 0
    lx, ly, lz = LIFT_M * normal[0], LIFT_M * normal[1], LIFT_M * normal[2]
    for i in range(len(lamps)):
        dx, dy, dz = lamps[i, 0] - point[0], lamps[i, 1] - point[1], lamps[i, 2] - point[2]
        cosine = dx * normal[0] + dy * normal[1] + dz * normal[2]
        if cosine <= 0:
            continue
        for k in range(count):  # first the one that blocked the neighbour
            f = chosen[(last + k) % count]
            if blocked(
                point[0] + lx, point[1] + ly, point[2] + lz,
                dx - lx, dy - ly, dz - lz, f, planes,
            ):  # fmt: skip
                last = (last + k) % count
                break
        else:
            distance2 = dx * dx + dy * dy + dz * dz
            total += lamps[i, 3] * cosine / math.sqrt(distance2) / (1 + distance2 / lamps[i, 4] ** 2)
    return total


@compiled
def light_row(
    f: int,
    y0: int,
    shape: Array,
    steps: Array,
    blockers: Blockers,
    lamps: Array,
    first: Array,
    spheres: Array,
    out: Array,
) -> None:
    """Add to the lattice `out` (rows, columns) of quad f what the lamps give, in the row of blocks that starts at y0."""
    rows, columns = shape[f]
    corner, normal, du, dv = blockers.corner[f], blockers.normal[f], steps[f, 0], steps[f, 1]
    y1 = min(y0 + BLOCK, rows)
    chosen, corners, point = np.empty(len(blockers.radius), np.int64), np.empty((4, 3)), np.empty(3)
    for x0 in range(0, columns, BLOCK):
        x1 = min(x0 + BLOCK, columns)
        for k in range(4):
            x, y = x1 if k % 2 else x0, y1 if k > 1 else y0
            for axis in range(3):
                corners[k, axis] = corner[axis] + LIFT_M * normal[axis] + x * du[axis] + y * dv[axis]
        for i in range(len(spheres)):
            middle, thick = spheres[i], spheres[i, 3]
            if dot(normal, middle) - blockers.planes[f, 0, 3] <= -thick:
                continue
            count = between(corners, middle, thick, f, blockers, chosen)
            points = lamps[first[i] : first[i + 1]]
            for y in range(y0, y1):
                for x in range(x0, x1):
                    for axis in range(3):
                        point[axis] = corner[axis] + (x + 0.5) * du[axis] + (y + 0.5) * dv[axis]
                    out[y, x] += received(point, normal, points, blockers.planes, chosen, count)


@compiled_parallel
def light_up(
    jobs: Array,
    shape: Array,
    start: Array,
    steps: Array,
    blockers: Blockers,
    lamps: Array,
    first: Array,
    spheres: Array,
    out: Array,
) -> None:
    """The same for the lattices of all quads, which lie in `out` one after the other. A job: quad, row of blocks."""
    for job in numba.prange(len(jobs)):
        f, row = jobs[job, 0], jobs[job, 1]
        lattice = out[start[f] : start[f + 1]].reshape((shape[f, 0], shape[f, 1]))
        light_row(f, row * BLOCK, shape, steps, blockers, lamps, first, spheres, lattice)
