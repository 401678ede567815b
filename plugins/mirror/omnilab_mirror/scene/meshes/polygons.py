"""Polygons split into triangles: convex ones as fans, others by clipping ears (Meisters, 1975)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Floats, Ints
from omnilab_mirror.compiled import compiled

Array = npt.NDArray[Any]
AT_ONCE = 100_000  # polygons
MAX_CORNERS = 5000  # of one that is not convex: the time grows with their square
FLAT = 1e-12  # of the square of its size: what has a smaller area is a line


class Split(NamedTuple):
    """T triangles of P polygons, polygon after polygon."""

    corners: Ints | None  # (T, 3) which of all corners; None: three after the other, since all polygons are triangles
    polygon: Ints | None  # (T,)
    crossing: int  # how many polygons cross themselves, or are too long, and were split as fans nevertheless

    def of_corners(self, values: Array) -> Array:
        """What is given for each of all corners (C, ...), for those of the triangles (T, 3, ...)."""
        return values.reshape(-1, 3, *values.shape[1:]) if self.corners is None else values[self.corners]

    def of_polygons(self, values: Array) -> Array:
        """What is given for each polygon (P, ...), for each triangle (T, ...)."""
        return values if self.polygon is None else values[self.polygon]


def split(points: Floats, vertex: Ints, counts: Ints) -> Split:
    """Triangles of polygons that have `counts` (P,) corners each, at `points[vertex]` (C, 3), one polygon after the other.

    Corners of fewer than three are left out. Areas are exact where a polygon is flat and does not cross itself.
    """
    if (counts == 3).all():
        return Split(None, None, 0)
    first = np.cumsum(counts) - counts
    corners, polygons, crossing = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)], 0
    for n in np.unique(counts[counts >= 3]):
        alike = np.nonzero(counts == n)[0]
        fan = _fan(int(n))
        for start in range(0, len(alike), AT_ONCE):
            some = alike[start : start + AT_ONCE]
            triangles = np.broadcast_to(fan, (len(some), *fan.shape)).copy()
            keep = np.ones(triangles.shape[:2], bool)
            if n > 3:
                shape = points[vertex[first[some, None] + np.arange(n)]]
                with np.errstate(invalid="ignore", over="ignore"):  # corners that are not finite are reported later
                    crossing += _clip_those_not_convex(shape, triangles)
                    keep = _with_area(shape, triangles)
            corners.append((triangles + first[some, None, None])[keep])
            polygons.append(np.broadcast_to(some[:, None], keep.shape)[keep])
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return Split(np.concatenate(corners)[order], polygon[order], crossing)


def _fan(n: int) -> Ints:
    """The triangles (n - 2, 3) of a convex polygon; a square is cut from its first corner to its third."""
    if n == 4:
        return np.array([[0, 1, 2], [2, 3, 0]])
    return np.column_stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)])


def _clip_those_not_convex(shape: Floats, triangles: Ints) -> int:
    """Write into `triangles` (G, n - 2, 3) those of the polygons (G, n, 3) that are not convex; how many cross themselves."""
    local = shape - shape[:, :1]
    normal = np.cross(local, np.roll(local, -1, axis=1)).sum(axis=1)  # Newell: twice the area long
    edges = np.roll(shape, -1, axis=1) - shape
    turns = np.einsum("gni,gi->gn", np.cross(edges, np.roll(edges, -1, axis=1)), normal)
    size = np.einsum("gni,gni->g", edges, edges)
    bent = ~(turns >= -FLAT * (size * np.linalg.norm(normal, axis=1))[:, None]).all(axis=1) | (
        _rounds(edges, turns) > 1.5
    )
    fan = np.cross(local[:, 1:-1], local[:, 2:])
    largest = np.take_along_axis(fan, np.argmax(np.linalg.norm(fan, axis=2), axis=1)[:, None, None], axis=1)[:, 0]
    none = np.linalg.norm(normal, axis=1) <= FLAT * size  # of a bow tie, too
    normal[none] = largest[none]
    bent |= none & (np.linalg.norm(largest, axis=1) > FLAT * size)
    crossing = 0
    for i in np.nonzero(bent & np.isfinite(normal).all(axis=1))[0]:
        flat = _flattened(local[i], normal[i])
        clipped = np.empty((len(flat) - 2, 3), np.int64)
        if len(flat) <= MAX_CORNERS and not crosses(flat) and clip_ears(flat, clipped):
            triangles[i] = clipped
        else:
            crossing += 1
    return crossing


def _rounds(edges: Floats, turns: Floats) -> Floats:
    """How often each polygon turns around (G,), all of its corners counted as left turns: once if it is convex."""
    ahead = np.roll(edges, -1, axis=1)
    lengths = np.linalg.norm(edges, axis=2) * np.linalg.norm(ahead, axis=2)
    cosine = np.einsum("gni,gni->gn", edges, ahead) / np.where(lengths > 0, lengths, 1)
    angles = np.where((lengths > 0) & (turns != 0), np.arccos(np.clip(cosine, -1, 1)), 0)
    return np.asarray(angles.sum(axis=1) / (2 * np.pi))


def _flattened(local: Floats, normal: Floats) -> Floats:
    """A polygon (n, 3) seen along the axis that its normal is nearest to, counter-clockwise (n, 2)."""
    axis = int(np.argmax(np.abs(normal)))
    x, y = (local[:, (axis + 1) % 3], local[:, (axis + 2) % 3])
    return np.ascontiguousarray(np.column_stack([x, y] if normal[axis] >= 0 else [y, x]))


def _with_area(shape: Floats, triangles: Ints) -> Bools:
    """Which triangles (G, n - 2) are no lines: corners in the middle of a straight edge make some. All, if all are."""
    a, b, c = (np.take_along_axis(shape, triangles[..., i, None], axis=1) for i in range(3))
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=2)
    keep = twice > FLAT * np.maximum(twice.max(axis=1, keepdims=True), 1e-300)
    return np.asarray(keep | ~np.isfinite(twice) | ~keep.any(axis=1, keepdims=True))


@compiled
def turn(p: Array, a: int, b: int, c: int) -> float:
    """Twice the area of a triangle of the points p (n, 2); positive if it is counter-clockwise."""
    area: float = (p[b, 0] - p[a, 0]) * (p[c, 1] - p[a, 1]) - (p[b, 1] - p[a, 1]) * (p[c, 0] - p[a, 0])
    return area


@compiled
def crosses(p: Array) -> bool:
    """Whether two edges of a polygon (n, 2) cross. Edges that touch, as those to a hole do, do not."""
    n = len(p)
    for i in range(n):
        for j in range(i + 2, n):
            k, m = i + 1, (j + 1) % n
            if m != i and turn(p, i, k, j) * turn(p, i, k, m) < 0 and turn(p, j, m, i) * turn(p, j, m, k) < 0:
                return True
    return False


@compiled
def clip_ears(p: Array, triangles: Array) -> bool:
    """Fill `triangles` (n - 2, 3) of a counter-clockwise polygon (n, 2); False if there is no ear left to clip."""
    n = len(p)
    before, after = np.arange(-1, n - 1), np.arange(1, n + 1)
    before[0], after[n - 1] = n - 1, 0
    left, count, b, missed, strict = n, 0, 0, 0, True
    while left > 3:
        a, c = before[b], after[b]
        area, ear = turn(p, a, b, c), False
        if area >= 0:
            ear, r = True, after[c]
            while area > 0 and r != a:  # a corner in the ear, or on its border unless there is no other way
                same = False
                for q in (a, b, c):
                    same |= p[r, 0] == p[q, 0] and p[r, 1] == p[q, 1]
                inside = min(turn(p, a, b, r), turn(p, b, c, r), turn(p, c, a, r))
                if not same and (inside > 0 or (strict and inside == 0)):
                    ear = False
                    break
                r = after[r]
        if ear:
            triangles[count, 0], triangles[count, 1], triangles[count, 2] = a, b, c
            after[a], before[c] = c, a
            left, count, b, missed = left - 1, count + 1, after[c], 0
        else:
            b, missed = c, missed + 1
        if missed > left:
            if not strict:
                return False
            strict, missed = False, 0
    triangles[count, 0], triangles[count, 1], triangles[count, 2] = before[b], b, after[b]
    return True
