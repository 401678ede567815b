"""SIFT of a picture: its strongest keypoints and their vectors."""

from __future__ import annotations

from functools import partial

import numpy as np

from omnilab.api import Bools, Bytes, Floats
from omnilab_appearance.common.sift.scale_space import LARGE, LAYERS, SIGMA, Octave, octaves
from omnilab_appearance.common.sift.two_threads import in_two

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
    from omnilab_appearance.common.sift.keypoint_kernels import described

    least = 255 * contrast / LAYERS
    scale_space = octaves(image, doubled)
    found = [_keypoints(octave, least) for octave in scale_space]
    octave = np.repeat(np.arange(len(found)), [len(points) for points in found])
    points = np.concatenate(found) if found else np.zeros((0, 4))
    step, start = (np.array([one[k] for one in scale_space])[octave][:, None] for k in (1, 2))
    uv = points[:, :2] * step + start
    u, v = np.rint(uv).astype(int).T
    kept = np.flatnonzero(mask[np.clip(v, 0, len(mask) - 1), np.clip(u, 0, mask.shape[1] - 1)])
    kept = kept[np.argsort(-points[kept, 3], kind="stable")[:count]]
    vectors = np.empty((len(kept), 128), np.uint8)
    for o, one in enumerate(scale_space):
        own = np.flatnonzero(octave[kept] == o)
        of_octave = np.empty((len(own), 128), np.uint8)
        in_two(
            partial(described, one.pictures, points[kept[own]], SIGMA, LAYERS, upright, of_octave),
            len(own),
            len(own) > SOME,
        )
        vectors[own] = of_octave
    return uv[kept], vectors


def _keypoints(octave: Octave, least: float) -> Floats:
    """Keypoints (K, 4) of an octave: x, y, layer, response; each once."""
    from omnilab_appearance.common.sift.keypoint_kernels import extrema, refined

    _, rows, columns = octave.pictures.shape
    flags = np.zeros((LAYERS, rows, columns), np.uint8)
    in_two(partial(extrema, octave.pictures, np.float32(EARLY * least), flags), rows, rows * columns >= LARGE)
    layer, row, column = np.unravel_index(np.flatnonzero(flags.view(bool)), flags.shape)
    places = np.stack([layer + 1, row, column], axis=1)
    points = np.empty((len(places), 4))
    points = points[: refined(octave.pictures, places, least, points)]
    return np.asarray(points[np.sort(np.unique(points[:, :3], axis=0, return_index=True)[1])])
