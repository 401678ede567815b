"""A world as a mesh for viewers."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from omnilab.api import Mesh
from omnilab_mirror.scene.meshes.triangles import joined
from omnilab_mirror.scene.quads import Face
from omnilab_mirror.scene.world import World

CELL_M = 0.25
MAX_CELLS = 16


def mesh_of(world: World) -> Mesh:
    """Two triangles for each cell of a face, coloured by its picture; meshes simplified; what is overhead is left out."""
    if not world.meshes:
        return _mesh_of_faces(world)
    from omnilab_mirror.scene.meshes.simplify import simplified

    meshes = [simplified(joined(world.meshes))]
    return _together([*meshes, _mesh_of_faces(world)] if world.faces else meshes)


def _together(meshes: list[Mesh]) -> Mesh:
    first = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, first, strict=False)]),
        np.concatenate([mesh.colors for mesh in meshes]),
    )


def _mesh_of_faces(world: World) -> Mesh:
    shown = [(face, picture) for face, picture in zip(world.faces, world.pictures, strict=True) if not face.overhead]
    vertices, triangles, colors, count = [], [], [], 0
    for face, picture in shown:
        columns, rows = _cells(face)
        vertices.append(_vertices(face, columns, rows))
        triangles.append(_triangles(columns, rows) + count)
        colors.append(cv2.resize(picture, (columns + 1, rows + 1), interpolation=cv2.INTER_AREA).reshape(-1, 3))
        count += len(vertices[-1])
    return Mesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(colors).astype(np.uint8))


def _cells(face: Face) -> tuple[int, int]:
    u, v = (min(MAX_CELLS, max(1, round(float(np.linalg.norm(edge)) / CELL_M))) for edge in (face.u, face.v))
    return u, v


def _vertices(face: Face, columns: int, rows: int) -> npt.NDArray[np.float64]:
    x, y = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)
    points = face.corner + x[None, :, None] * face.u + y[:, None, None] * face.v
    return np.asarray(points.reshape(-1, 3))


def _triangles(columns: int, rows: int) -> npt.NDArray[np.int64]:
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    up = columns + 1
    return np.asarray(corner + np.array([0, 1, up + 1, 0, up + 1, up])).reshape(-1, 3)
