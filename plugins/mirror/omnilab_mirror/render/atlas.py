"""Texture atlas: the pictures of all quads at all resolutions (mipmaps), in one array."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes

Array = npt.NDArray[Any]

LUMA = np.array([0.299, 0.587, 0.114])  # Rec. 601


class Atlas(NamedTuple):
    """Mipmaps of F pictures."""

    first: Array  # (F + 1,): the lines of `levels` that belong to quad f are first[f] to first[f + 1]
    levels: Array  # (L, 3): start, width and height of each picture, the finest of a quad first
    texels: Array  # (T, C) uint16, in 1/256 grey levels

    @property
    def size(self) -> Array:
        """Texels (F,) of each quad's finest picture."""
        return np.asarray(self.levels[self.first[:-1], 1:].prod(axis=1))


def build_atlas(pictures: list[Bytes], color: bool) -> Atlas:
    """The pictures (h, w, 3), or their Rec. 601 luma, each halved until it is one texel."""
    chains = [list(_halved(picture if color else picture @ LUMA)) for picture in pictures]
    levels = [level for chain in chains for level in chain]
    shapes = np.array([(level.shape[1], level.shape[0]) for level in levels], np.int64)
    starts = np.cumsum([0, *shapes.prod(axis=1)])[:-1]
    texels = np.concatenate([np.rint(level * 256).astype(np.uint16).reshape(-1, 3 if color else 1) for level in levels])
    return Atlas(np.cumsum([0, *map(len, chains)]), np.column_stack([starts, shapes]), texels)


def _halved(picture: Array) -> Iterator[Array]:
    picture = picture.astype(np.float32)
    yield picture
    while max(picture.shape[:2]) > 1:
        half = max(1, picture.shape[1] // 2), max(1, picture.shape[0] // 2)
        picture = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
        yield picture
