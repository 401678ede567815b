"""Textures of triangles: bilinear colours of pictures at the resolution of the pixel, for a wave of rays."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled
from omnilab_mirror.render.ray_waves import (
    FX,
    FY,
    HALVED,
    HEIGHT,
    LOWER_LEFT,
    LOWER_RIGHT,
    PICTURE,
    START,
    TEXELS,
    UPPER_LEFT,
    UPPER_RIGHT,
    WAVE,
    WEIGHT,
    WIDTH,
    WRAPS,
    Wave,
    X,
    Y,
)

Array = npt.NDArray[Any]


@compiled
def halvings(texels: float) -> int:
    """How often a picture is halved until a pixel that covers `texels` of it covers one to four; negative: it is too coarse."""
    exponent: Any = ((np.float64(texels).view(np.int64) >> 52) & 2047) - 1022  # that of frexp
    return exponent >> 1 if exponent < 1025 else 0


@compiled
def choose_levels(first: Array, levels: Array, wave: Wave, count: int) -> None:
    """START, WIDTH and HEIGHT of the pictures as often halved as HALVED says, if they are."""
    double, whole = wave.double, wave.whole
    for k in range(count):
        picture = np.uintp(whole[PICTURE + k])  # numba asks of signed indices whether they count from the end
        level = np.uintp(min(first[picture] + max(whole[HALVED + k], 0), first[picture + np.uintp(1)] - 1))
        double[START + k], double[WIDTH + k], double[HEIGHT + k] = levels[level, 0], levels[level, 1], levels[level, 2]


@compiled
def near(i: float, count: float, wraps: bool) -> float:
    """The texel i of `count` in a line, which may lie one beyond either end."""
    before, behind = (count - 1, 0.0) if wraps else (0.0, count - 1)
    return before if i < 0 else behind if i >= count else i


@compiled
def find_texels(wave: Wave, count: int) -> None:
    """The four texels around the places (X, Y), and where these lie between them. All in floating point: it has vector instructions."""
    double, whole = wave.double, wave.whole
    for k in range(count):
        wraps, width, height = double[WRAPS + k] != 0, double[WIDTH + k], double[HEIGHT + k]
        x, y = double[X + k], double[Y + k]
        x, y = (x - np.floor(x) if wraps else x), (y - np.floor(y) if wraps else y)
        x, y = x * width - 0.5, y * height - 0.5
        left, top = np.floor(x), np.floor(y)
        double[FX + k], double[FY + k] = x - left, y - top
        left, right = near(left, width, wraps), near(left + 1, width, wraps)
        upper = double[START + k] + near(top, height, wraps) * width
        lower = double[START + k] + near(top + 1, height, wraps) * width
        whole[UPPER_LEFT + k], whole[UPPER_RIGHT + k] = np.int32(upper + left), np.int32(upper + right)
        whole[LOWER_LEFT + k], whole[LOWER_RIGHT + k] = np.int32(lower + left), np.int32(lower + right)


@compiled
def fetch_texels(texels: Array, wave: Wave, count: int) -> None:
    """The colours (T, C) of the four texels."""
    double, whole = wave.double, wave.whole
    for k in range(count):
        a, b = np.uintp(whole[UPPER_LEFT + k]), np.uintp(whole[UPPER_RIGHT + k])
        c, d = np.uintp(whole[LOWER_LEFT + k]), np.uintp(whole[LOWER_RIGHT + k])
        for channel in range(texels.shape[1]):
            row = TEXELS + 4 * channel * WAVE + k
            double[row], double[row + WAVE] = texels[a, channel], texels[b, channel]
            double[row + 2 * WAVE], double[row + 3 * WAVE] = texels[c, channel], texels[d, channel]


@compiled
def blend(wave: Wave, count: int, channel: int) -> None:
    """Make WEIGHT of a channel the colour of the rays: times the bilinear mean of the four texels."""
    double = wave.double
    row, weight = TEXELS + 4 * channel * WAVE, WEIGHT + channel * WAVE
    for k in range(count):
        fx, fy = double[FX + k], double[FY + k]
        high = double[row + k] * (1 - fx) + double[row + WAVE + k] * fx
        low = double[row + 2 * WAVE + k] * (1 - fx) + double[row + 3 * WAVE + k] * fx
        double[weight + k] *= high * (1 - fy) + low * fy
