"""Scale space of SIFT: octaves of blurred pictures (Lowe, 2004, 3)."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_appearance.common.sift.two_threads import in_two

LAYERS = 3  # scales of an octave in which extrema are looked for
SIGMA = 1.6  # blur of an octave's first picture, in its own pixels
CAMERA_SIGMA = 0.5  # blur that pictures come with, in their pixels
SMALLEST = 16  # pixels a side of the last octave
LARGE = 200_000  # pixels of a picture that is worth two threads
REACH = 3.0  # standard deviations at which a blur's kernel ends


class Octave(NamedTuple):
    """A picture at one sampling, and ever more blur. Layers are the differences of each picture and the one before."""

    pictures: Floats  # (LAYERS + 3, h, w) float32: picture k has the blur SIGMA 2^(k / LAYERS)
    step: float  # from one sample to the next, in pixels of the original
    start: float  # the first sample, right of and below the middle of the original's first pixel


def octaves(image: Bytes, doubled: bool) -> list[Octave]:
    """The octaves of a picture (H, W), of which the first has its resolution, or twice that."""
    import cv2

    first, *steps = _sigmas(doubled)
    picture = image.astype(np.float32)
    step, start = 1.0, 0.0
    if doubled:
        picture, step, start = cv2.resize(picture, None, fx=2, fy=2), 0.5, -0.25
    base = _blurred(picture, first)
    found = []
    while min(base.shape) >= SMALLEST:
        pictures = np.empty((LAYERS + 3, *base.shape), np.float32)
        pictures[0] = base
        for k, sigma in enumerate(steps):
            in_two(partial(_blur_rows, pictures[k], sigma, pictures[k + 1]), len(base), base.size >= LARGE)
        found.append(Octave(pictures, step, start))
        base, step = np.ascontiguousarray(pictures[LAYERS, ::2, ::2]), 2 * step
    return found


@lru_cache(maxsize=2)
def _sigmas(doubled: bool) -> list[float]:
    """Blurs: up to that of an octave's first picture, and from each picture to the next."""
    blur = SIGMA * 2.0 ** (np.arange(LAYERS + 3) / LAYERS)
    there = CAMERA_SIGMA * (2 if doubled else 1)
    return [float(np.sqrt(SIGMA**2 - there**2)), *np.sqrt(np.diff(blur**2)).tolist()]


def _blur_rows(picture: Floats, sigma: float, out: Floats, first: int, last: int) -> None:
    """Write the rows first to last of a picture, blurred, into `out`."""
    reach = math.ceil(REACH * sigma)
    low, high = max(first - reach, 0), min(last + reach, len(picture))
    out[first:last] = _blurred(picture[low:high], sigma)[first - low : last - low]


def _blurred(picture: Floats, sigma: float) -> Floats:
    import cv2

    side = 2 * math.ceil(REACH * sigma) + 1
    return np.asarray(cv2.GaussianBlur(picture, (side, side), sigma))
