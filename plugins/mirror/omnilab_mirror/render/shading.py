"""Shading of what rays meet on triangles: texture at the resolution of the pixel, tint, and light."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled
from omnilab_mirror.render.atlas import Atlas

Array = npt.NDArray[Any]


class Surface(NamedTuple):
    """What shading needs of T triangles; picture -1 of the atlas is the sky."""

    uv: Array  # (T, 3, 2)
    normal: Array  # (T, 3), unit length
    density: Array  # (T,) texels of the finest level for a square metre
    picture: Array  # (T,)
    painted: Array  # (T,)
    tint: Array  # (T, 3, C) uint8, or (0, 3, C) where nothing is tinted


class Lighting(NamedTuple):
    """Light on triangles that are not painted."""

    ambient: float
    overhead: Array  # (3,): its scalar product with the normal is added to the ambient light
    lamps: Array  # (L, 5): x, y, z, power, reach


class Hits(NamedTuple):
    """Hits of R rays."""

    pixel: Array  # (R,) which pixel of the image each ray belongs to, in ascending order
    origin: Array  # (R, 3)
    direction: Array  # (R, 3), unit length
    solid_angle: Array  # (R,) of the pixel
    triangle: Array  # (R,), -1: none
    distance: Array  # (R,)
    u: Array  # (R,) weight of the second corner
    v: Array  # (R,) weight of the third corner


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
    texels: Array, start: int, width: int, height: int, x: float, y: float, wraps: bool, weight: Array, total: Array
) -> None:
    """Add to `total` (C,) the bilinear colour at fractions (x, y) of the picture at `start`, times `weight` (C,)."""
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
        total[c] += weight[c] * (low * (1 - fy) + high * fy)


@compiled
def finer(area: float, first: int, end: int) -> int:
    """Which of the levels from `first` on, before `end`, suits a pixel that covers `area` texels of the finest."""
    _, exponent = math.frexp(area)
    return min(first + max(exponent >> 1, 0), end - 1)


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
def shade(hits: Hits, samples: int, surface: Surface, light: Lighting, atlas: Atlas, image: Array) -> None:
    """Fill the pixels (H * W, C) that the rays belong to with the means over `samples` rays."""
    # in one function and with arrays of its own: each use of an array in a tuple counts its references
    pixel, origin, direction, solid_angle, triangle, distance, hit_u, hit_v = hits
    uv, normal, density, pictures, painted, tint = surface
    ambient, overhead, lamps = light
    first, levels, texels = atlas
    channels, rays, sky = image.shape[1], len(pixel), len(first) - 2
    sky_density = levels[first[sky], 1] * levels[first[sky], 2] / (2 * math.pi * math.pi)  # texels per steradian
    total, weight = np.zeros(channels), np.ones(channels)
    for r in range(rays):
        dx, dy, dz = direction[r, 0], direction[r, 1], direction[r, 2]
        t = triangle[r]
        if t < 0:
            k = finer(solid_angle[r] * sky_density, first[sky], first[sky + 1])
            half = 0.5 / levels[k, 2]  # the sky wraps around, but not from pole to pole
            x, y = math.atan2(dy, dx) / (2 * math.pi), math.acos(min(max(dz, -1.0), 1.0)) / math.pi
            y, wraps = min(max(y, half), 1 - half), True
            weight[:] = 1
        else:
            far, u, v = distance[r], hit_u[r], hit_v[r]
            w = 1 - u - v
            x = w * uv[t, 0, 0] + u * uv[t, 1, 0] + v * uv[t, 2, 0]
            y = w * uv[t, 0, 1] + u * uv[t, 1, 1] + v * uv[t, 2, 1]
            nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
            cosine = nx * dx + ny * dy + nz * dz
            covered = solid_angle[r] * far * far / max(abs(cosine), 1e-6)  # square metres
            k = finer(covered * density[t], first[pictures[t]], first[pictures[t] + 1])
            wraps, lit = not painted[t], 1.0
            if not painted[t]:
                if cosine > 0:  # the side that is seen
                    nx, ny, nz = -nx, -ny, -nz
                lit = ambient + nx * overhead[0] + ny * overhead[1] + nz * overhead[2]
                px, py, pz = origin[r, 0] + far * dx, origin[r, 1] + far * dy, origin[r, 2] + far * dz
                lit += lambert(nx, ny, nz, px, py, pz, lamps)
            weight[:] = lit
            if len(tint):
                for c in range(channels):
                    weight[c] *= (w * tint[t, 0, c] + u * tint[t, 1, c] + v * tint[t, 2, c]) / 255
        add_texel(texels, levels[k, 0], levels[k, 1], levels[k, 2], x, y, wraps, weight, total)
        if r + 1 == rays or pixel[r + 1] != pixel[r]:
            for c in range(channels):
                # light may be stronger than white
                image[pixel[r], c] = np.uint8(min(total[c] / (256 * samples), 255.0) + 0.5)
                total[c] = 0


@compiled
def turn(directions: Array, R: Array, out: Array) -> None:
    """R @ d for each of the directions (N, 3): numpy's product of such thin matrices waits for threads."""
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        for j in range(3):
            out[i, j] = R[j, 0] * x + R[j, 1] * y + R[j, 2] * z
