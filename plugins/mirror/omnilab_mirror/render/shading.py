"""Shading of what rays meet on triangles: texture at the resolution of the pixel, tint, and light."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled, compiled_parallel
from omnilab_mirror.render.atlas import Atlas
from omnilab_mirror.render.embree_tree import EmbreeCall
from omnilab_mirror.render.ray_waves import (
    B1,
    B2,
    DENSITY,
    DISTANCE,
    DX,
    DY,
    DZ,
    HALVED,
    HIT,
    LIT,
    NX,
    NY,
    NZ,
    OX,
    OY,
    OZ,
    PICTURE,
    U0,
    U1,
    U2,
    V0,
    V1,
    V2,
    WAVE,
    WEIGHT,
    WRAPS,
    Bundle,
    Wave,
    X,
    Y,
    meet,
    new_wave,
)
from omnilab_mirror.render.texturing import blend, choose_levels, fetch_texels, find_texels, halvings
from omnilab_mirror.render.triangle_table import OF_PICTURE, PAINTED, TINT

Array = npt.NDArray[Any]


class Lighting(NamedTuple):
    """Light on triangles that are not painted."""

    ambient: float
    overhead: Array  # (3,): its scalar product with the normal is added to the ambient light
    lamps: Array  # (L, 5): x, y, z, power, reach


@compiled
def find_surfaces(table: Array, wave: Wave, count: int) -> bool:
    """What the table says of the triangles that are met; whether a ray meets none, which has that of the first."""
    single, double, whole = wave.single, wave.double, wave.whole
    pictures, missed = table.view(np.int32), False
    for k in range(count):
        missed |= whole[HIT + k] < 0
        t = np.uintp(max(whole[HIT + k], 0))
        for i in range(10):
            single[U0 + i * WAVE + k] = table[t, i]
        whole[PICTURE + k], double[WRAPS + k] = pictures[t, OF_PICTURE], pictures[t, PAINTED] == 0
    return missed


@compiled
def find_places(wave: Wave, count: int) -> None:
    """Where on their pictures the rays meet triangles."""
    single, double = wave.single, wave.double
    for k in range(count):
        u, v = single[B1 + k], single[B2 + k]
        w = 1 - u - v
        double[X + k] = w * single[U0 + k] + u * single[U1 + k] + v * single[U2 + k]
        double[Y + k] = w * single[V0 + k] + u * single[V1 + k] + v * single[V2 + k]


@compiled
def light_up(solid_angle: Array, first: int, light: Lighting, wave: Wave, count: int) -> None:
    """Turn the normals to the side that is seen; how coarse pictures may be, and the light of no lamp."""
    single, double, whole = wave.single, wave.double, wave.whole
    ambient, x, y, z = light.ambient, light.overhead[0], light.overhead[1], light.overhead[2]
    for k in range(count):
        nx, ny, nz, far = single[NX + k], single[NY + k], single[NZ + k], single[DISTANCE + k]
        cosine = nx * single[DX + k] + ny * single[DY + k] + nz * single[DZ + k]
        covered = solid_angle[first + k] * far * far / max(abs(cosine), 1e-6)  # square metres
        whole[HALVED + k] = halvings(covered * single[DENSITY + k])
        if cosine > 0:
            nx, ny, nz = -nx, -ny, -nz
        single[NX + k], single[NY + k], single[NZ + k] = nx, ny, nz
        # what is painted does not wrap, and has its light
        double[LIT + k] = ambient + nx * x + ny * y + nz * z if double[WRAPS + k] != 0 else 1.0


@compiled
def add_lamps(lamps: Array, wave: Wave, count: int) -> None:
    """The light of all lamps on what is not painted (Lambert's cosine law)."""
    single, double = wave.single, wave.double
    for k in range(count):
        if double[WRAPS + k] != 0:
            nx, ny, nz, far = single[NX + k], single[NY + k], single[NZ + k], single[DISTANCE + k]
            x, y = single[OX + k] + far * single[DX + k], single[OY + k] + far * single[DY + k]
            z = single[OZ + k] + far * single[DZ + k]
            total = 0.0
            for i in range(len(lamps)):
                lx, ly, lz = lamps[i, 0] - x, lamps[i, 1] - y, lamps[i, 2] - z
                distance = math.sqrt(lx * lx + ly * ly + lz * lz)
                cosine = max(nx * lx + ny * ly + nz * lz, 0.0) / max(distance, 1e-9)
                total += lamps[i, 3] * cosine / (1 + (distance / lamps[i, 4]) ** 2)
            double[LIT + k] += total


@compiled
def see_sky(solid_angle: Array, start: int, first: Array, levels: Array, wave: Wave, count: int) -> None:
    """What rays that meet nothing see: the last picture, which wraps around, but not from pole to pole."""
    single, double, whole, sky = wave.single, wave.double, wave.whole, len(first) - 2
    texels = levels[first[sky], 1] * levels[first[sky], 2]
    for k in range(count):
        if whole[HIT + k] >= 0:
            continue
        halved = halvings(solid_angle[start + k] * (texels / (2 * math.pi * math.pi)))
        whole[PICTURE + k], whole[HALVED + k] = sky, halved
        double[WRAPS + k], double[LIT + k] = 1.0, 1.0
        double[X + k], double[Y + k] = 0.5, 0.5
        if texels > 1:  # one is the same everywhere
            half = 0.5 / levels[min(first[sky] + max(halved, 0), first[sky + 1] - 1), 2]
            double[X + k] = math.atan2(single[DY + k], single[DX + k]) / (2 * math.pi)
            down = math.acos(min(max(single[DZ + k], -1.0), 1.0)) / math.pi
            double[Y + k] = min(max(down, half), 1 - half)


@compiled
def weigh(table: Array, tinted: bool, wave: Wave, count: int, channels: int) -> None:
    """The light, in each channel times the tint if there is one."""
    single, double, whole, tint = wave.single, wave.double, wave.whole, table.view(np.uint8)
    for c in range(channels):
        for k in range(count):
            double[WEIGHT + c * WAVE + k] = double[LIT + k]
        for k in range(count if tinted else 0):
            t = whole[HIT + k]
            if t >= 0:
                u, v = single[B1 + k], single[B2 + k]
                b0, b1, b2 = tint[t, TINT + c], tint[t, TINT + channels + c], tint[t, TINT + 2 * channels + c]
                double[WEIGHT + c * WAVE + k] *= ((1 - u - v) * b0 + u * b1 + v * b2) / 255


@compiled
def write(pixel: Array, start: int, end: int, wave: Wave, count: int, samples: int, total: Array, image: Array) -> None:
    """Add colours to `total` (C,), and write it to a pixel with its last ray."""
    double = wave.double
    for k in range(count):
        r = start + k
        for c in range(len(total)):
            total[c] += double[WEIGHT + c * WAVE + k]
        if r + 1 == end or pixel[r + 1] != pixel[r]:
            for c in range(len(total)):
                mean = total[c] / (256 * samples)
                image[pixel[r], c] = np.uint8(min(mean, 255.0) + 0.5)  # light may be stronger than white
                total[c] = 0


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

    `table`: (T, NUMBERS) float32 of the triangles. The same rays are always sent together, so the number of threads changes nothing.
    """
    parts, channels = bundle.parts, image.shape[1]
    for part in numba.prange(len(parts) - 1):
        wave, total, end = new_wave(), np.zeros(channels), parts[part + 1]
        for start in range(parts[part], end, WAVE):
            count = min(WAVE, end - start)
            meet(bundle, R, at, call, start, count, wave)
            missed = find_surfaces(table, wave, count)
            find_places(wave, count)
            light_up(bundle.solid_angle, start, light, wave, count)
            if len(light.lamps):
                add_lamps(light.lamps, wave, count)
            if missed:
                see_sky(bundle.solid_angle, start, atlas.first, atlas.levels, wave, count)
            weigh(table, tinted, wave, count, channels)
            choose_levels(atlas.first, atlas.levels, wave, count)
            find_texels(wave, count)
            fetch_texels(atlas.texels, wave, count)
            for channel in range(channels):
                blend(wave, count, channel)
            write(bundle.pixel, start, end, wave, count, samples, total, image)


@compiled_parallel
def measure(bundle: Bundle, R: Array, at: Array, call: EmbreeCall, depth: Array) -> None:
    """Fill `depth` (H * W,) with how far rays of one a pixel go from a pose (R, at), infinity where they meet nothing."""
    for part in numba.prange(len(bundle.parts) - 1):
        wave, pixel, end = new_wave(), bundle.pixel, bundle.parts[part + 1]
        distance, hit = wave.single, wave.whole
        for start in range(bundle.parts[part], end, WAVE):
            count = min(WAVE, end - start)
            meet(bundle, R, at, call, start, count, wave)
            for k in range(count):
                depth[pixel[start + k]] = math.inf if hit[HIT + k] < 0 else distance[DISTANCE + k]
