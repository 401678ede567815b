"""Worlds that consist of one mesh file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from omnilab.errors import DataError
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.meshes.mesh_file import read_mesh
from omnilab_mirror.scene.meshes.triangles import Triangles
from omnilab_mirror.scene.world import World

# textures mostly hold their light; the rest lets surfaces without a texture keep their shape
LIGHT = Illumination(0.85, [], skylight=0.15)
LARGEST_M = 5000
SKY = np.full((1, 1, 3), (190, 208, 230), np.uint8)


def world_of_mesh(file: Path) -> World:
    """A mesh, moved so that its middle lies above the origin and its floor at height 0; the map is all of its area."""
    found = read_mesh(file)
    low, high = found.triangles.bounds
    middle = np.array([*(low + high)[:2] / 2, floor_height(found.triangles)])
    x, y, _ = high - low
    if max(x, y) > LARGEST_M:
        raise DataError(
            f"{file} measures {x:.0f} x {y:.0f} m, a world may have {LARGEST_M} m; if it is in millimetres, name it in a"
            " world file, with scale: 0.001"
        )
    return World(
        digest=found.digest,
        map_m=(float(x), float(y)),
        quads=[],
        solids=[],
        areas=[],
        light=LIGHT,
        texels_per_m=1,
        seed=0,
        sky=SKY,
        meshes=[found.triangles.moved(np.eye(3), -middle)],
        notes=found.notes,
        sources=found.sources,
    )


def floor_height(triangles: Triangles) -> float:
    """Where in the lower half most level area lies, to 5 cm; the lowest corner where nothing is level."""
    (_, _, low), (_, _, high) = triangles.bounds
    z, normals = triangles.corners[..., 2].mean(axis=1), triangles.normals
    area = np.linalg.norm(normals, axis=1)
    floor = (np.abs(normals[:, 2]) > 0.95 * area) & (z <= (low + high) / 2)
    if not floor.any():
        return float(low)
    bins = np.floor((z[floor] - low) / 0.05).astype(int)
    highest = np.argmax(np.bincount(bins, area[floor]))
    inside = bins == highest
    return float(np.average(z[floor][inside], weights=area[floor][inside]))
