"""Waves of rays: a camera's rays in the world, and what they meet, in rows of numbers.

Each step of rendering goes through a whole wave. It is a loop along rows, which becomes vector instructions, and the rows stay
in the processor's first cache from step to step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled
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
WAVE = 64  # rays; what is known of each lies so far apart:
# in `single`: direction, origin, distance, weights of the second and third corner, and ten numbers of the triangle
DX, DY, DZ, OX, OY, OZ, DISTANCE, B1, B2, U0, V0, U1, V1, U2, V2, NX, NY, NZ, DENSITY = range(0, 19 * WAVE, WAVE)
# in `double`: place on the picture, light, place between texels, the picture's start, size, and whether it is repeated;
# of up to three channels the weights, and the four texels
X, Y, LIT, FX, FY, START, WIDTH, HEIGHT, WRAPS, WEIGHT = range(0, 10 * WAVE, WAVE)
TEXELS, DOUBLES = 12 * WAVE, 24 * WAVE
# in `whole`: triangle, -1 where none is met; its picture; how often that is halved; indices of the four texels
HIT, PICTURE, HALVED, UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT = range(0, 7 * WAVE, WAVE)


class Bundle(NamedTuple):
    """R rays of a camera, in its frame: those of a pixel together, neighbouring pixels near each other."""

    pixel: Array  # (R,) of the image, row by row
    direction: Array  # (3, R) float32
    solid_angle: Array  # (R,) float32 of the pixel
    origin: Array | None  # (3, R) float32, metres; None: all start at the viewpoint
    parts: Array  # (P + 1,): rays parts[i] to parts[i + 1], of whole pixels, are for one thread at a time


class Wave(NamedTuple):
    """What is known of WAVE rays, in the rows above, and the packet in which they are sent."""

    single: Array  # float32
    double: Array
    whole: Array  # int32
    packet: tuple[Array, Array, int]


@compiled
def new_wave() -> Wave:
    """Room for a wave."""
    single, double, whole = np.zeros(19 * WAVE, np.float32), np.zeros(DOUBLES), np.zeros(7 * WAVE, np.int32)
    return Wave(single, double, whole, new_packet())


@compiled
def turn(vectors: Array, R: Array, first: int, count: int, row: int, single: Array) -> None:
    """Put `count` vectors (3, N), from the `first` on, into the rows from `row` on: turned by R."""
    x, y, z = vectors[0], vectors[1], vectors[2]
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        for k in range(count):
            single[row + i * WAVE + k] = a * x[first + k] + b * y[first + k] + c * z[first + k]


@compiled
def start_from(starts: Array | None, R: Array, at: Array, first: int, count: int, single: Array) -> None:
    """The origins of `count` rays: `starts` turned by R and moved to `at`."""
    if starts is not None:
        turn(starts, R, first, count, OX, single)
    for i in range(3):
        for k in range(count):
            single[OX + i * WAVE + k] = at[i] if starts is None else single[OX + i * WAVE + k] + at[i]


@compiled
def meet(bundle: Bundle, R: Array, at: Array, call: EmbreeCall, first: int, count: int, wave: Wave) -> None:
    """Fill a wave with `count` rays from the `first` on, seen from a pose (R, at), and with what they meet."""
    single, hit, (packet, whole, address) = wave.single, wave.whole, wave.packet
    turn(bundle.direction, R, first, count, DX, single)
    start_from(bundle.origin, R, at, first, count, single)
    for q in range(0, count, LANES):
        for i in range(3):
            for k in range(LANES):
                packet[DIRECTION + i, k] = single[DX + i * WAVE + q + k]
                packet[ORIGIN + i, k] = single[OX + i * WAVE + q + k]
        cast(call, packet, whole, address, min(LANES, count - q))
        for k in range(LANES):
            single[DISTANCE + q + k] = packet[FAR, k]
            single[B1 + q + k], single[B2 + q + k] = packet[U, k], packet[V, k]
            hit[HIT + q + k] = whole[TRIANGLE, k]
