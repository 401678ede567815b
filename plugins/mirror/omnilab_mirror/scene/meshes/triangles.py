"""Triangles with pictures, colours and names: meshes, and quads where a world also holds meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Bytes, Floats, Ints
from omnilab_mirror.scene.meshes.corners import extent, moved, normals_of
from omnilab_mirror.scene.quads import Quad

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Triangles:
    """T triangles, the pictures on them and what they belong to."""

    corners: Floats  # (T, 3, 3) float32, metres in the world frame
    uv: Floats  # (T, 3, 2) float32: right and down in fractions of the picture
    picture: Ints  # (T,) int32, index into `pictures`
    colors: Bytes  # (T, 3, 3) of the corners, which tint the picture
    name: Ints  # (T,) int32, index into `names`
    painted: Bools  # (T,): light is in the picture already, and the picture ends at its edge
    pictures: list[Bytes]  # (h, w, 3) each, row 0 where uv's second is 0
    names: list[str]

    def __len__(self) -> int:
        return len(self.corners)

    def __getitem__(self, which: Array) -> Triangles:
        fields = ("corners", "uv", "picture", "colors", "name", "painted")
        return replace(self, **{field: getattr(self, field)[which] for field in fields})

    @cached_property
    def _extent(self) -> tuple[Floats, bool]:
        return extent(self.corners)

    @property
    def bounds(self) -> Floats:
        """Lowest and highest corner (2, 3)."""
        return self._extent[0]

    @property
    def is_finite(self) -> bool:
        """Whether no corner is NaN or infinite."""
        return self._extent[1]

    @cached_property
    def tinted(self) -> bool:
        """Whether any corner has another colour than white."""
        return bool(np.any(self.colors < 255))

    @cached_property
    def _normals(self) -> tuple[Floats, Floats]:
        return normals_of(self.corners)

    @property
    def normals(self) -> Floats:
        """Normals (T, 3), twice the area long, by the right hand around the corners."""
        return self._normals[0]

    @property
    def twice_areas(self) -> Floats:
        """The normals' lengths (T,)."""
        return self._normals[1]

    def moved(self, matrix: Floats, at: Floats) -> Triangles:
        """All points x become matrix @ x + at."""
        if np.array_equal(matrix, np.eye(3)) and not np.any(at):
            return self
        return replace(self, corners=moved(self.corners, np.asarray(matrix, float), np.asarray(at, float)))


def one_part(corners: Floats, uv: Floats | None, colors: Bytes | None, picture: Bytes, name: str) -> Triangles:
    """Triangles with one picture and name; without `uv` they have its first corner, without `colors` they are white."""
    count = len(corners)
    return Triangles(
        corners,
        np.broadcast_to(np.float32(0), (count, 3, 2)) if uv is None else uv,
        np.broadcast_to(np.int32(0), count),
        np.broadcast_to(np.uint8(255), (count, 3, 3)) if colors is None else colors,
        np.broadcast_to(np.int32(0), count),
        np.broadcast_to(np.bool_(False), count),
        [picture],
        [name],
    )


def joined(parts: Sequence[Triangles]) -> Triangles:
    """Several as one; a picture that they share is kept once."""
    pictures = {id(picture): picture for part in parts for picture in part.pictures}
    if len(parts) == 1 and len(pictures) == len(parts[0].pictures):
        return parts[0]
    number = {key: i for i, key in enumerate(pictures)}
    index = [np.array([number[id(picture)] for picture in part.pictures], np.int32) for part in parts]
    names = np.cumsum([0, *(len(part.names) for part in parts)])
    return Triangles(
        np.concatenate([part.corners for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([numbers[part.picture] for part, numbers in zip(parts, index, strict=True)]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate([part.name + first for part, first in zip(parts, names, strict=False)]).astype(np.int32),
        np.concatenate([part.painted for part in parts]),
        list(pictures.values()),
        [name for part in parts for name in part.names],
    )


def halves(quads: Sequence[Quad], pictures: list[Bytes]) -> Triangles:
    """Two triangles for each quad, with its painted picture."""
    square = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], np.float32)
    edges = np.array([(quad.u, quad.v) for quad in quads])
    corners = np.array([quad.corner for quad in quads])[:, None, None] + np.einsum("tci,fij->ftcj", square, edges)
    count = 2 * len(quads)
    return Triangles(
        corners.reshape(-1, 3, 3).astype(np.float32),
        np.tile(square, (len(quads), 1, 1)),
        np.repeat(np.arange(len(quads), dtype=np.int32), 2),
        np.full((count, 3, 3), 255, np.uint8),
        np.zeros(count, np.int32),
        np.ones(count, bool),
        pictures,
        ["quad"],
    )
