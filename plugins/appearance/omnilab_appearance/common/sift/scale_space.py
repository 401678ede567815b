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
BLURS = SIGMA * 2.0 ** (np.arange(LAYERS + 3) / LAYERS)  # of the pictures of an octave
STEPS = np.sqrt(np.diff(BLURS**2)).tolist()  # blurs that make of each of them the next


class Octave(NamedTuple):
    """A picture at one sampling, and ever more blur. Layers are the differences of each picture and the one before."""

    pictures: Floats  # (LAYERS + 3, h, w) float32: picture k has the blur SIGMA 2^(k / LAYERS)
    step: float  # from one sample to the next, in pixels of the original
    start: float  # the first sample, right of and below the middle of the original's first pixel


def first_octave(image: Bytes, doubled: bool) -> Octave | None:
    """The octave of a picture (H, W) that has its resolution, or twice that; None of a very small picture.

    Its last pictures, which smaller octaves do not depend on, are yet to be made: see `finish`.
    """
    import cv2

    picture = image.astype(np.float32)
    step, start = 1.0, 0.0
    if doubled:
        picture, step, start = cv2.resize(picture, None, fx=2, fy=2), 0.5, -0.25
    if min(picture.shape) < SMALLEST:
        return None
    pictures = np.empty((LAYERS + 3, *picture.shape), np.float32)
    large = picture.size >= LARGE
    first = math.sqrt(SIGMA**2 - (CAMERA_SIGMA / step) ** 2)
    in_two(partial(blur, picture, first, pictures[0]), len(picture), large)
    for k, sigma in enumerate(STEPS[:LAYERS]):
        in_two(partial(blur, pictures[k], sigma, pictures[k + 1]), len(picture), large)
    return Octave(pictures, step, start)


def finish(octave: Octave) -> None:
    """Make the pictures of an octave that follow the one from which the next octave is made."""
    for k in range(LAYERS, len(STEPS)):
        blur(octave.pictures[k], STEPS[k], octave.pictures[k + 1], 0, octave.pictures.shape[1])


def smaller_octaves(octave: Octave) -> list[Octave]:
    """All octaves after one, each of half the resolution of that before it."""
    found = list[Octave]()
    while min(octave.pictures.shape[1:]) > 2 * (SMALLEST - 1):
        base = octave.pictures[LAYERS, ::2, ::2]
        pictures = np.empty((LAYERS + 3, *base.shape), np.float32)
        pictures[0] = base
        for k, sigma in enumerate(STEPS):
            blur(pictures[k], sigma, pictures[k + 1], 0, len(base))
        octave = Octave(pictures, 2 * octave.step, octave.start)
        found.append(octave)
    return found


def blur(picture: Floats, sigma: float, out: Floats, first: int, last: int) -> None:
    """Write rows first to below last of a picture (H, W) float32, blurred, to `out` (H, W).

    A picture must be larger than half the kernel, either way.
    """
    from omnilab_appearance.common.sift.blur_kernels import blurred

    taps = _taps(sigma)
    blurred(picture, taps, (0,) * (len(taps) // 2), out, first, last)


@lru_cache(maxsize=32)
def _taps(sigma: float) -> Floats:
    """A Gaussian (2 reach + 1,) float32 whose sum is 1."""
    import cv2

    return np.asarray(cv2.getGaussianKernel(2 * math.ceil(REACH * sigma) + 1, sigma, cv2.CV_32F)[:, 0])
