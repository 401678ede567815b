"""Coarse coloured mesh of a world for viewers."""

from __future__ import annotations

import cv2
import numpy as np

from omnilab.api import Floats, Ints, Mesh
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.meshes.triangles import joined
from omnilab_mirror.scene.quads import Quad
from omnilab_mirror.scene.world import World

CELL_M = 0.25
MAX_CELLS = 16


def mesh_of(world: World) -> Mesh:
    """Two triangles for each cell of a quad, coloured by its picture; meshes simplified; what is overhead is left out.

    Quads face where they are seen from, such as the inside of a room; meshes of files face anywhere.
    """
    if not world.meshes:
        return _mesh_of_quads(world)
    from omnilab_mirror.scene.meshes.simplify import simplified

    meshes = [simplified(joined(world.meshes))]
    return _together([*meshes, _mesh_of_quads(world)] if world.quads else meshes)


def _together(meshes: list[Mesh]) -> Mesh:
    first = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, first, strict=False)]),
        np.concatenate([mesh.colors for mesh in meshes]),
    )


def _mesh_of_quads(world: World) -> Mesh:
    shown = [
        (quad, picture) for quad, picture in zip(world.quads, baked_pictures(world), strict=True) if not quad.overhead
    ]
    vertices, triangles, colors, count = [], [], [], 0
    for quad, picture in shown:
        columns, rows = _cells(quad)
        vertices.append(_vertices(quad, columns, rows))
        triangles.append(_triangles(columns, rows) + count)
        colors.append(cv2.resize(picture, (columns + 1, rows + 1), interpolation=cv2.INTER_AREA).reshape(-1, 3))
        count += len(vertices[-1])
    return Mesh(
        np.concatenate(vertices), np.concatenate(triangles), np.concatenate(colors).astype(np.uint8), one_sided=True
    )


def _cells(quad: Quad) -> tuple[int, int]:
    u, v = (min(MAX_CELLS, max(1, round(float(np.linalg.norm(edge)) / CELL_M))) for edge in (quad.u, quad.v))
    return u, v


def _vertices(quad: Quad, columns: int, rows: int) -> Floats:
    x, y = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)
    points = quad.corner + x[None, :, None] * quad.u + y[:, None, None] * quad.v
    return np.asarray(points.reshape(-1, 3))


def _triangles(columns: int, rows: int) -> Ints:
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    up = columns + 1
    return np.asarray(corner + np.array([0, 1, up + 1, 0, up + 1, up])).reshape(-1, 3)
