"""Ray tracer of quads: every quad is a parallelogram, and all rays of an image leave one point, or points around it.

With a quad at corner p, edges e1 and e2, seen from O, let r0, r1, r2 be the rows of [p - O, e1, e2]^-1. The ray O + t d
meets the quad where w = r0.d > 0 and 0 <= r1.d <= w and 0 <= r2.d <= w, at t = 1 / w: the nearest quad has the largest
w. Whole blocks of pixels, and then the tiles in them, first cull what none of their rays can see: a cone against the
five planes through O that bound a quad. The rays of a tile, one of each pixel, are tried against a quad all at once.

Rays that start at O + o instead, |o| <= rho, meet the quad's plane n.x = n.p where t = (n.p - n.o) / n.d; w is 1 / t
again. From O a point that such a ray meets lies in another direction than d, by asin(rho / distance) at most, so the
cones are that much wider, and nearer or farther by rho at most.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled, compiled_parallel
from omnilab_mirror.render.atlas import Atlas

Array = npt.NDArray[Any]
# constants of this file, since numba's cache sees no changes in others
TILE, BLOCK = 8, 32  # pixels
LANES = (
    TILE * TILE
)  # the rays of a tile that are traced at once, one of each pixel; what is known of each lies so far apart:
X, Y, Z, BEST, HIT, B1, B2, OFF, OX, OY, OZ = range(0, 11 * LANES, LANES)
EDGE = 1e-9  # neighbouring quads overlap by this much of 1/m, so that no ray slips between them


class Cones(NamedTuple):
    """A cone around the rays of each of (V, U) squares of pixels."""

    axis: Array  # (V, U, 3)
    spread: Array  # (V, U, 2): cosine and sine of the angle to the axis that no ray exceeds
    around: Array  # (V, U): no ray starts farther than this from the viewpoint, in metres


class View(NamedTuple):
    """F quads as seen from N viewpoints, in the camera's frame."""

    rows: Array  # (N, F, 9): r0, r1, r2. Rays around O: (N, F, 12): n, n.p, and for both edges g, g.p with g.(x - p) the share
    planes: Array  # (N, F, 5, 3): inward unit normals of the planes through O that bound the quad; r0's first
    reach: Array  # (N, F): the length of r0, 1 over the distance of the quad's plane
    density: Array  # (N, F): texels of the finest level over |det| (rays around O: over the area)
    turn: Array  # (N, 3, 3): from the camera's directions to the world's


def view_from(T_world_camera: Array, corner: Array, edges: Array, texels: Array) -> View:
    """Quads with corners (F, 3), edges (F, 2, 3) and `texels` (F,) as seen from poses (N, 4, 4)."""
    p = corner - T_world_camera[:, None, :3, 3]
    e1, e2 = np.broadcast_to(edges[:, 0], p.shape), np.broadcast_to(edges[:, 1], p.shape)
    normal = np.cross(edges[:, 0], edges[:, 1])
    det = np.einsum("nfi,fi->nf", p, normal)
    edge_on = np.abs(det) < 1e-12  # the viewpoint lies in the quad's plane
    inverse = np.where(edge_on, 0.0, 1 / np.where(edge_on, 1.0, det))
    rows = np.stack([np.broadcast_to(normal, p.shape), np.cross(e2, p), np.cross(p, e1)], 2) * inverse[..., None, None]
    rows = rows @ T_world_camera[:, None, :3, :3]
    r0, r1, r2 = rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]
    planes = np.stack([r0, r1, r0 - r1, r2, r0 - r2], 2)
    length = np.linalg.norm(planes, axis=-1)
    planes = planes / np.maximum(length, 1e-300)[..., None]
    rows = rows.reshape(*det.shape, 9)
    turn = T_world_camera[:, :3, :3]
    return View(*map(np.ascontiguousarray, (rows, planes, length[..., 0], texels * np.abs(inverse), turn)))


def view_around(T_world_camera: Array, corner: Array, edges: Array, texels: Array) -> View:
    """The same for rays that start around the viewpoints."""
    view = view_from(T_world_camera, corner, edges, texels)
    p = (corner - T_world_camera[:, None, :3, 3]) @ view.turn
    normal = np.cross(edges[:, 0], edges[:, 1])
    area = np.linalg.norm(normal, axis=-1, keepdims=True)
    shares = np.stack([np.cross(edges[:, 1], normal), np.cross(normal, edges[:, 0])], 1) / area[:, None] ** 2
    vectors = np.concatenate([(normal / area)[:, None], shares], 1) @ view.turn[:, None]
    at_corner = np.einsum("nfki,nfi->nfk", vectors, p)
    rows = np.concatenate([vectors, at_corner[..., None]], -1).reshape(*p.shape[:2], 12)
    reach = 1 / np.maximum(np.abs(at_corner[..., 0]), 1e-12)
    return View(rows, view.planes, reach, np.broadcast_to(texels / area[:, 0], reach.shape).copy(), view.turn)


@compiled
def dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@compiled
def widened(cos: float, sin: float, by: float) -> tuple[float, float]:
    """The cosine and sine of an angle plus asin(by); those of a cone that may hold anything, once it is no cone."""
    c = math.sqrt(max(0.0, 1 - by * by))
    wide = cos * c - sin * by
    return (wide, sin * c + cos * by) if by < 1 and wide > 0 and cos > 0 else (-2.0, 2.0)


@compiled
def cull(
    axis: Array,
    spread: Array,
    around: float,
    planes: Array,
    reach: Array,
    among: Array,
    number: int,
    chosen: Array,
    limit: Array,
) -> int:
    """Which of the first `number` quads of `among` a cone may see: how many they are.

    They go to `chosen`, nearest first, and the largest w that each can have to `limit`.
    """
    cos, sin = spread[0], spread[1]
    count = 0
    behind = 0.0  # some quad fills the cone at this w or more: what stays below is hidden
    for n in range(number):
        f = among[n]
        if around > 0:
            cos, sin = widened(spread[0], spread[1], around * reach[f])
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
        if around > 0:
            most = most / (1 - around * most) if around * most < 1 else math.inf
        if most <= behind:
            continue
        if inside > sin:
            least = reach[f] * (c * cos - s * sin)
            behind = max(behind, least / (1 + around * least) * (1 - 1e-9))
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
def load(rays: Array, starts: Array | None, tile: tuple[int, int, int, int], s: int, lanes: Array) -> None:
    """Put the rays number s of a tile's pixels into `lanes`, row by row; a lane without a pixel meets nothing."""
    top, bottom, left, right = tile
    for r in range(LANES):
        lanes[X + r], lanes[Y + r], lanes[Z + r] = 0.0, 0.0, 0.0
        lanes[BEST + r], lanes[HIT + r], lanes[OFF + r] = math.inf, -1.0, 1.0
    for v in range(top, bottom):
        for u in range(left, right):
            r = (v - top) * TILE + u - left
            lanes[BEST + r] = 0.0
            lanes[X + r], lanes[Y + r], lanes[Z + r] = rays[v, u, s, 0], rays[v, u, s, 1], rays[v, u, s, 2]
            if starts is not None:
                lanes[OX + r], lanes[OY + r], lanes[OZ + r] = starts[v, u, s, 0], starts[v, u, s, 1], starts[v, u, s, 2]


@compiled
def may_hit(lanes: Array, limit: float) -> bool:
    """Whether any of the rays may meet a quad whose w has this limit before what it met."""
    count = 0
    for r in range(LANES):
        count += lanes[BEST + r] < limit
    return count > 0


@compiled
def meet(rows: Array, limit: Array, count: int, lanes: Array) -> None:
    """Which of `count` quads (C, 9) each ray meets first, the largest w, and there the products with r1 and r2.

    Every quad is tried for all rays of the tile at once: in one loop without branches, so that it becomes vector code.
    """
    for k in range(count):
        most = limit[k]
        if not may_hit(lanes, most):
            break
        p0, p1, p2 = rows[k, 0], rows[k, 1], rows[k, 2]
        q0, q1, q2 = rows[k, 3], rows[k, 4], rows[k, 5]
        s0, s1, s2 = rows[k, 6], rows[k, 7], rows[k, 8]
        for r in range(LANES):
            x, y, z, best = lanes[X + r], lanes[Y + r], lanes[Z + r], lanes[BEST + r]
            w = p0 * x + p1 * y + p2 * z
            a1 = q0 * x + q1 * y + q2 * z
            a2 = s0 * x + s1 * y + s2 * z
            inside = (a1 >= -EDGE) & (a1 <= w + EDGE) & (a2 >= -EDGE) & (a2 <= w + EDGE)
            met = inside & (w > best) & (most > best)
            lanes[BEST + r] = w if met else best
            lanes[HIT + r] = k if met else lanes[HIT + r]
            lanes[B1 + r] = a1 if met else lanes[B1 + r]
            lanes[B2 + r] = a2 if met else lanes[B2 + r]


@compiled
def meet_around(rows: Array, limit: Array, count: int, lanes: Array) -> None:
    """The same for rays that start around the viewpoint, with quads (C, 12); and their starts' distances from the plane hit."""
    for k in range(count):
        most = limit[k]
        if not may_hit(lanes, most):
            break
        n0, n1, n2, n3 = rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3]
        g0, g1, g2, g3 = rows[k, 4], rows[k, 5], rows[k, 6], rows[k, 7]
        h0, h1, h2, h3 = rows[k, 8], rows[k, 9], rows[k, 10], rows[k, 11]
        for r in range(LANES):
            x, y, z, best = lanes[X + r], lanes[Y + r], lanes[Z + r], lanes[BEST + r]
            ox, oy, oz = lanes[OX + r], lanes[OY + r], lanes[OZ + r]
            apart = n3 - (n0 * ox + n1 * oy + n2 * oz)
            w = (n0 * x + n1 * y + n2 * z) / apart
            w = w if apart != 0 else 0.0
            a1 = g0 * x + g1 * y + g2 * z + w * (g0 * ox + g1 * oy + g2 * oz - g3)
            a2 = h0 * x + h1 * y + h2 * z + w * (h0 * ox + h1 * oy + h2 * oz - h3)
            inside = (a1 >= -EDGE) & (a1 <= w + EDGE) & (a2 >= -EDGE) & (a2 <= w + EDGE)
            met = inside & (w > best) & (most > best)
            lanes[BEST + r] = w if met else best
            lanes[HIT + r] = k if met else lanes[HIT + r]
            lanes[B1 + r] = a1 if met else lanes[B1 + r]
            lanes[B2 + r] = a2 if met else lanes[B2 + r]
            lanes[OFF + r] = abs(apart) if met else lanes[OFF + r]


@compiled
def add_texel(texels: Array, start: int, width: int, height: int, x: float, y: float, total: Array, r: int) -> None:
    """Add to `total[r]` (C,) the bilinear colour at fractions (x, y) of the picture that begins at `start`."""
    px = min(max(x * width - 0.5, 0.0), width - 1.0)
    py = min(max(y * height - 0.5, 0.0), height - 1.0)
    x0, y0 = int(px), int(py)
    fx, fy = px - x0, py - y0
    a = start + y0 * width + x0
    b = a + (width if y0 + 1 < height else 0)
    right = 1 if x0 + 1 < width else 0
    for channel in range(total.shape[1]):
        low = texels[a, channel] * (1 - fx) + texels[a + right, channel] * fx
        high = texels[b, channel] * (1 - fx) + texels[b + right, channel] * fx
        total[r, channel] += low * (1 - fy) + high * fy


@compiled
def first_hits(
    rays: Array,
    starts: Array | None,
    tile: tuple[int, int, int, int],
    s: int,
    rows: Array,
    limit: Array,
    count: int,
    lanes: Array,
) -> None:
    """Fill `lanes` for the rays number s of a tile's pixels."""
    load(rays, starts, tile, s, lanes)
    if starts is not None:
        meet_around(rows, limit, count, lanes)
    else:
        meet(rows, limit, count, lanes)


@compiled
def level_of(first: Array, picture: int, texels: float) -> int:
    """The line of `Atlas.levels` at whose resolution a pixel covers a texel, when it covers `texels` of the finest."""
    _, exponent = math.frexp(texels)  # 4^level texels
    return int(min(first[picture] + max(exponent >> 1, 0), first[picture + 1] - 1))


@compiled
def add_sky(
    first: Array, levels: Array, texels: Array, picture: int, ray: Array, turn: Array, total: Array, r: int
) -> None:
    """Add to `total[r]` (C,) the sky's colour in the direction of a ray; its picture holds the sky twice, side by side."""
    x, y, z = dot(turn[0], ray), dot(turn[1], ray), dot(turn[2], ray)
    across = 0.5 + math.atan2(y, x) / (4 * math.pi)  # in the middle half of the picture, so that the sky has no seam
    down = math.acos(min(max(z, -1.0), 1.0)) / math.pi
    width, height = levels[first[picture], 1], levels[first[picture], 2]
    covered = ray[3] * width * height / (4 * math.pi**2 * max(math.hypot(x, y), 1e-3))
    level = level_of(first, picture, covered)
    add_texel(texels, levels[level, 0], levels[level, 1], levels[level, 2], across, down, total, r)


@compiled
def shade(
    rays: Array,
    starts: Array | None,
    tile: tuple[int, int, int, int],
    rows: Array,
    limit: Array,
    chosen: Array,
    count: int,
    density: Array,
    turn: Array,
    atlas: Atlas,
    lanes: Array,
    out: Array,
) -> None:
    """Fill the pixels of a tile in the image `out` (H, W, C) with the means over their rays."""
    top, bottom, left, right = tile
    first, levels, texels = atlas  # each use of an array in a tuple counts its references
    samples = rays.shape[2]
    sky = len(first) - 1 > len(density)  # its picture follows the quads'
    total = np.zeros((LANES, out.shape[2]))
    for s in range(samples):
        first_hits(rays, starts, tile, s, rows, limit, count, lanes)
        for v in range(top, bottom):
            for u in range(left, right):
                r = (v - top) * TILE + u - left
                k = int(lanes[HIT + r])
                if k >= 0:
                    f, t = chosen[k], 1 / lanes[BEST + r]
                    # the pixel covers solid_angle t^2 / cos on the quad
                    level = level_of(first, f, rays[v, u, s, 3] * density[f] * (t * t * t) / lanes[OFF + r])
                    start, width, height = levels[level, 0], levels[level, 1], levels[level, 2]
                    add_texel(texels, start, width, height, lanes[B1 + r] * t, lanes[B2 + r] * t, total, r)
                elif sky and rays[v, u, s, 3] > 0:
                    add_sky(first, levels, texels, len(density), rays[v, u, s], turn, total, r)
    for v in range(top, bottom):
        for u in range(left, right):
            for channel in range(out.shape[2]):
                out[v, u, channel] = np.uint8(total[(v - top) * TILE + u - left, channel] / (256 * samples) + 0.5)


@compiled
def measure(
    rays: Array,
    starts: Array | None,
    tile: tuple[int, int, int, int],
    rows: Array,
    limit: Array,
    count: int,
    lanes: Array,
    out: Array,
) -> None:
    """Fill the pixels of a tile in `out` (H, W) with how far their first rays go; infinity where they meet nothing."""
    top, bottom, left, right = tile
    first_hits(rays, starts, tile, 0, rows, limit, count, lanes)
    for v in range(top, bottom):
        for u in range(left, right):
            r = (v - top) * TILE + u - left
            out[v, u] = 1 / lanes[BEST + r] if lanes[HIT + r] >= 0 else math.inf


@compiled
def trace_row(
    rays: Array, starts: Array | None, blocks: Cones, tiles: Cones, view: View, i: int, bv: int, atlas: Atlas | None,
    out: Array,
) -> None:  # fmt: skip
    """Fill a row of blocks in image i, or without an atlas its depths."""
    height, width = rays.shape[:2]
    planes, reach, all_rows, density = view.planes[i], view.reach[i], view.rows[i], view.density[i]
    quads, columns = all_rows.shape
    everything, some, few = np.arange(quads), np.empty(quads, np.int64), np.empty(quads, np.int64)
    limit, rows, lanes = np.empty(quads), np.empty((quads, columns)), np.empty(LANES * 11)
    for bu in range(blocks.axis.shape[1]):
        axis, spread, around = blocks.axis[bv, bu], blocks.spread[bv, bu], blocks.around[bv, bu]
        number = cull(axis, spread, around, planes, reach, everything, quads, some, limit)
        for v in range(bv * BLOCK, min(bv * BLOCK + BLOCK, height), TILE):
            for u in range(bu * BLOCK, min(bu * BLOCK + BLOCK, width), TILE):
                tv, tu = v // TILE, u // TILE
                axis, spread, around = tiles.axis[tv, tu], tiles.spread[tv, tu], tiles.around[tv, tu]
                count = cull(axis, spread, around, planes, reach, some, number, few, limit)
                for k in range(count):
                    for c in range(columns):  # assigning a row takes seconds to compile
                        rows[k, c] = all_rows[few[k], c]
                tile = v, min(v + TILE, height), u, min(u + TILE, width)
                if atlas is None:
                    measure(rays, starts, tile, rows, limit, count, lanes, out)
                else:
                    shade(rays, starts, tile, rows, limit, few, count, density, view.turn[i], atlas, lanes, out)


@compiled_parallel
def trace(
    rays: Array, starts: Array | None, blocks: Cones, tiles: Cones, view: View, atlas: Atlas | None, out: Array
) -> None:
    """Fill the images `out` (N, H, W, C), or without an atlas the depths (N, H, W) in metres along the rays.

    Each pixel is computed alone, so the number of threads changes nothing.
    """
    blocks_v = len(blocks.axis)
    for job in numba.prange(len(out) * blocks_v):
        i, bv = job // blocks_v, job % blocks_v
        trace_row(rays, starts, blocks, tiles, view, i, bv, atlas, out[i])
