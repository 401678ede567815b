"""Shading of what rays meet on triangles: texture at the resolution of the pixel, tint, and light."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled, compiled_parallel
from omnilab_mirror.render.atlas import Atlas
from omnilab_mirror.render.embree_tree import (
    DIRECTION,
    FAR,
    LANES,
    ORIGIN,
    TRIANGLE,
    EmbreeCall,
    U,
    V,
    cast,
    new_packet,
)

Array = npt.NDArray[Any]
# what is known of a triangle, in one line of a processor's cache: numbers of 32 bits, and the tint from byte TINT on
UV, NORMAL, DENSITY, PICTURE, PAINTED, NUMBERS, TINT = 0, 6, 9, 10, 11, 16, 48


class Lighting(NamedTuple):
    """Light on triangles that are not painted."""

    ambient: float
    overhead: Array  # (3,): its scalar product with the normal is added to the ambient light
    lamps: Array  # (L, 5): x, y, z, power, reach


class Bundle(NamedTuple):
    """R rays of a camera, in its frame: those of a pixel together, neighbouring pixels near each other."""

    pixel: Array  # (R,) of the image, row by row
    direction: Array  # (3, R) float32
    solid_angle: Array  # (R,) float32 of the pixel
    origin: Array | None  # (3, R) float32, metres; None: all start at the viewpoint
    parts: Array  # (P + 1,): rays parts[i] to parts[i + 1], of whole pixels, are for one thread at a time


@compiled
def near(i: int, count: int, wraps: bool) -> int:
    """The texel i of `count` in a line, which may lie one beyond either end."""
    if i < 0:
        return count - 1 if wraps else 0
    if i >= count:
        return 0 if wraps else count - 1
    return i


@compiled
def add_texel(
    texels: Array,
    start: int,
    width: int,
    height: int,
    x: float,
    y: float,
    wraps: bool,
    weight: Array,
    k: int,
    total: Array,
) -> None:
    """Add to `total` (C,) the bilinear colour at fractions (x, y) of the picture at `start`, times weight[k] (C,)."""
    if wraps:
        x, y = x - math.floor(x), y - math.floor(y)
    px, py = x * width - 0.5, y * height - 0.5
    left, top = math.floor(px), math.floor(py)
    fx, fy = px - left, py - top
    x0, x1 = near(left, width, wraps), near(left + 1, width, wraps)
    a, b = start + near(top, height, wraps) * width, start + near(top + 1, height, wraps) * width
    for c in range(len(total)):
        low = texels[a + x0, c] * (1 - fx) + texels[a + x1, c] * fx
        high = texels[b + x0, c] * (1 - fx) + texels[b + x1, c] * fx
        total[c] += weight[k, c] * (low * (1 - fy) + high * fy)


@compiled
def finer(area: float, first: int, end: int) -> int:
    """Which of the levels from `first` on, before `end`, suits a pixel that covers `area` texels of the finest."""
    exponent: Any = ((np.float64(area).view(np.int64) >> 52) & 2047) - 1022  # that of frexp
    return min(first + max(exponent >> 1, 0), end - 1) if exponent < 1025 else first


@compiled
def lambert(nx: float, ny: float, nz: float, x: float, y: float, z: float, lamps: Array) -> float:
    """The light of all lamps at a point (x, y, z) with a normal."""
    total = 0.0
    for k in range(len(lamps)):
        lx, ly, lz = lamps[k, 0] - x, lamps[k, 1] - y, lamps[k, 2] - z
        distance = math.sqrt(lx * lx + ly * ly + lz * lz)
        cosine = max(nx * lx + ny * ly + nz * lz, 0.0) / max(distance, 1e-9)
        total += lamps[k, 3] * cosine / (1 + (distance / lamps[k, 4]) ** 2)
    return total


@compiled
def fill(d: Array, starts: Array | None, R: Array, at: Array, first: int, count: int, packet: Array) -> None:
    """Put `count` rays from `first` on, of directions d (3, N) and `starts`, into a packet: turned by R and moved to `at`."""
    for i in range(3):
        for k in range(count):
            r = first + k
            packet[DIRECTION + i, k] = R[i, 0] * d[0, r] + R[i, 1] * d[1, r] + R[i, 2] * d[2, r]
            if starts is None:
                packet[ORIGIN + i, k] = at[i]
            else:
                packet[ORIGIN + i, k] = R[i, 0] * starts[0, r] + R[i, 1] * starts[1, r] + R[i, 2] * starts[2, r] + at[i]


@compiled
def sky_at(dx: float, dy: float, dz: float, half: float) -> tuple[float, float]:
    """Where on its picture the sky is seen: it wraps around, but not from pole to pole."""
    x, y = math.atan2(dy, dx) / (2 * math.pi), math.acos(min(max(dz, -1.0), 1.0)) / math.pi
    return x, min(max(y, half), 1 - half)


@compiled_parallel
def render(
    bundle: Bundle,
    R: Array,
    at: Array,
    samples: int,
    call: EmbreeCall,
    table: Array,
    tinted: bool,
    light: Lighting,
    atlas: Atlas,
    image: Array,
) -> None:
    """Fill the pixels (H * W, C) of a bundle's rays, seen from a pose (R, at), with the means over `samples` rays.

    `table`: (T, NUMBERS) float32 of the triangles. Each pixel is computed alone, so the number of threads changes nothing.
    """
    # arrays of its own: each use of an array in a tuple counts its references
    pixel, direction, solid_angle, starts, parts = bundle
    ambient, overhead, lamps = light
    first, levels, texels = atlas
    channels, sky = image.shape[1], len(first) - 2
    whole, tint = table.view(np.int32), table.view(np.uint8)
    sky_density = levels[first[sky], 1] * levels[first[sky], 2] / (2 * math.pi * math.pi)  # texels per steradian
    for part in numba.prange(len(parts) - 1):
        packet, hits, address = new_packet()
        total, weight, end = np.zeros(channels), np.ones((LANES, channels)), parts[part + 1]
        place, level, wraps = np.empty((LANES, 2)), np.empty(LANES, np.int64), np.empty(LANES, np.bool_)
        for start in range(parts[part], end, LANES):
            count = min(LANES, end - start)
            fill(direction, starts, R, at, start, count, packet)
            cast(call, packet, hits, address, count)
            for k in range(count):
                r, t = start + k, hits[TRIANGLE, k]
                dx, dy, dz = packet[DIRECTION, k], packet[DIRECTION + 1, k], packet[DIRECTION + 2, k]
                if t < 0:
                    level[k] = finer(solid_angle[r] * sky_density, first[sky], first[sky + 1])
                    place[k, 0], place[k, 1] = sky_at(dx, dy, dz, 0.5 / levels[level[k], 2])
                    wraps[k] = True
                    for c in range(channels):
                        weight[k, c] = 1.0
                    continue
                far, u, v = packet[FAR, k], packet[U, k], packet[V, k]
                w = 1 - u - v
                place[k, 0] = w * table[t, UV] + u * table[t, UV + 2] + v * table[t, UV + 4]
                place[k, 1] = w * table[t, UV + 1] + u * table[t, UV + 3] + v * table[t, UV + 5]
                nx, ny, nz = table[t, NORMAL], table[t, NORMAL + 1], table[t, NORMAL + 2]
                cosine = nx * dx + ny * dy + nz * dz
                covered = solid_angle[r] * far * far / max(abs(cosine), 1e-6)  # square metres
                picture, wraps[k], lit = whole[t, PICTURE], whole[t, PAINTED] == 0, 1.0
                level[k] = finer(covered * table[t, DENSITY], first[picture], first[picture + 1])
                if wraps[k]:  # what is painted does not, and has its light
                    if cosine > 0:  # the side that is seen
                        nx, ny, nz = -nx, -ny, -nz
                    lit = ambient + nx * overhead[0] + ny * overhead[1] + nz * overhead[2]
                    px, py, pz = (
                        packet[ORIGIN, k] + far * dx,
                        packet[ORIGIN + 1, k] + far * dy,
                        packet[ORIGIN + 2, k] + far * dz,
                    )
                    lit += lambert(nx, ny, nz, px, py, pz, lamps)
                for c in range(channels):
                    weight[k, c] = lit
                    if tinted:
                        b0, b1, b2 = tint[t, TINT + c], tint[t, TINT + channels + c], tint[t, TINT + 2 * channels + c]
                        weight[k, c] *= (w * b0 + u * b1 + v * b2) / 255
            for k in range(count):
                r, i = start + k, level[k]
                add_texel(
                    texels,
                    levels[i, 0],
                    levels[i, 1],
                    levels[i, 2],
                    place[k, 0],
                    place[k, 1],
                    wraps[k],
                    weight,
                    k,
                    total,
                )
                if r + 1 == end or pixel[r + 1] != pixel[r]:
                    for c in range(channels):
                        # light may be stronger than white
                        image[pixel[r], c] = np.uint8(min(total[c] / (256 * samples), 255.0) + 0.5)
                        total[c] = 0


@compiled_parallel
def measure(bundle: Bundle, R: Array, at: Array, call: EmbreeCall, depth: Array) -> None:
    """Fill `depth` (H * W,) with how far rays of one a pixel go from a pose (R, at), infinity where they meet nothing."""
    for part in numba.prange(len(bundle.parts) - 1):
        packet, hits, address = new_packet()
        end = bundle.parts[part + 1]
        for start in range(bundle.parts[part], end, LANES):
            count = min(LANES, end - start)
            fill(bundle.direction, bundle.origin, R, at, start, count, packet)
            cast(call, packet, hits, address, count)
            for k in range(count):
                depth[bundle.pixel[start + k]] = math.inf if hits[TRIANGLE, k] < 0 else packet[FAR, k]
