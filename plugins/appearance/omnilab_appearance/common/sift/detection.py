"""SIFT of a picture: its strongest keypoints and their vectors."""

from __future__ import annotations

from functools import partial

import numpy as np

from omnilab.api import Bools, Bytes, Floats, Ints
from omnilab_appearance.common.sift.scale_space import (
    LARGE,
    LAYERS,
    SIGMA,
    Octave,
    finish,
    first_octave,
    smaller_octaves,
)
from omnilab_appearance.common.sift.two_threads import beside, in_two

SOME = 40  # keypoints that are worth two threads
EARLY = 0.8  # of the least contrast: a sample has less than the extremum between the samples


def sift(
    image: Bytes, mask: Bools, count: int, contrast: float, upright: bool = False, doubled: bool = True
) -> tuple[Floats, Bytes]:
    """Pixels (F, 2) = (u, v) of the `count` strongest keypoints of a picture (H, W) within a mask, and vectors (F, 128) uint8.

    Strongest first. A keypoint has one direction, that of most gradients around it; `upright` ones have the picture's.
    Least contrast as OpenCV has it: a difference of Gaussians of `contrast` / LAYERS between black 0 and white 1. Doubled
    pictures show features that are half as large, in three times the time.
    """
    scale_space, found = _scale_space(image, 255 * contrast / LAYERS, doubled)
    octave = np.repeat(np.arange(len(found)), [len(points) for points in found])
    points = np.concatenate(found) if found else np.zeros((0, 4))
    step, start = (np.array([one[k] for one in scale_space])[octave][:, None] for k in (1, 2))
    uv = points[:, :2] * step + start
    u, v = np.rint(uv).astype(int).T
    kept = np.flatnonzero(mask[np.clip(v, 0, len(mask) - 1), np.clip(u, 0, mask.shape[1] - 1)])
    kept = kept[np.argsort(-points[kept, 3], kind="stable")[:count]]
    return uv[kept], _described(scale_space, octave[kept], points[kept], upright)


def _scale_space(image: Bytes, least: float, doubled: bool) -> tuple[list[Octave], list[Floats]]:
    """The octaves of a picture, and the keypoints (K, 4) of each.

    The smaller octaves, a third of the work, are made in the other thread while the first one is finished.
    """
    first = first_octave(image, doubled)
    if first is None:
        return [], []

    def others() -> list[tuple[Octave, Floats]]:
        return [(octave, _keypoints(octave, least, large=False)) for octave in smaller_octaves(first)]

    large = first.pictures[0].size >= LARGE
    smaller = beside(others, partial(finish, first), large)
    points = _keypoints(first, least, large)
    return [first, *(octave for octave, _ in smaller)], [points, *(found for _, found in smaller)]


def _keypoints(octave: Octave, least: float, large: bool) -> Floats:
    """Keypoints (K, 4) of an octave: x, y, layer, response; each once. Of a `large` one with the other thread."""
    from omnilab_appearance.common.sift.keypoint_kernels import extrema, refined

    _, rows, columns = octave.pictures.shape
    flags = np.zeros((LAYERS, rows, columns), np.uint8)
    in_two(partial(extrema, octave.pictures, np.float32(EARLY * least), flags), rows, large)
    layer, row, column = np.unravel_index(np.flatnonzero(flags.view(bool)), flags.shape)
    places = np.stack([layer + 1, row, column], axis=1)
    points = np.empty((len(places), 4))
    return points[: refined(octave.pictures, places, least, flags, points)]


def _described(scale_space: list[Octave], octave: Ints, points: Floats, upright: bool) -> Bytes:
    """Vectors (K, 128) of keypoints (K, 4), each of one octave."""
    from omnilab_appearance.common.sift.keypoint_kernels import described

    order = np.argsort(octave, kind="stable")
    sorted_points, vectors = points[order], np.empty((len(points), 128), np.uint8)
    ends = np.searchsorted(octave[order], np.arange(len(scale_space) + 1))

    def describe(first: int, last: int) -> None:
        for one, low, high in zip(scale_space, ends, ends[1:], strict=False):
            start, stop = max(low, first), min(high, last)
            described(one.pictures, sorted_points, SIGMA, LAYERS, upright, vectors, start, max(start, stop))

    in_two(describe, len(points), len(points) > SOME)
    return vectors[np.argsort(order)]
