"""Worlds that consist of one mesh file."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path

import numpy as np

from omnilab.errors import DataError
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.meshes.hints import UNITS, hints, likely_unit, size_of
from omnilab_mirror.scene.meshes.mesh_file import read_mesh
from omnilab_mirror.scene.meshes.triangles import Triangles
from omnilab_mirror.scene.world import World

log = logging.getLogger("omnilab")
# textures mostly hold their light; the rest lets surfaces without a texture keep their shape
LIGHT = Illumination(0.85, [], skylight=0.15)
LARGEST_M = 5000
SKY = np.full((1, 1, 3), (190, 208, 230), np.uint8)


def world_of_mesh(file: Path, up: str | None = None, scale: float = 1.0) -> World:
    """A mesh, moved so that its middle lies above the origin and its floor at height 0; the map is all of its area.

    `up`: the file's axis that points up (None: y in GLB, else z); `scale`: metres a unit of the file.
    """
    found = read_mesh(file, up)
    low, high = found.triangles.bounds * scale
    if max((high - low)[:2]) > LARGEST_M:
        unit = likely_unit((high - low) / scale)
        raise DataError(
            f"{file} is {size_of(high - low)}, a world may have {LARGEST_M} m; if it is in {unit}, set"
            f" sensor.scale={UNITS[unit]} (in a world file, scale: {UNITS[unit]})"
        )
    triangles = found.triangles if scale == 1 else found.triangles.moved(scale * np.eye(3), np.zeros(3))
    level = floor_height(triangles)
    floor_m = float(low[2]) if level is None else level
    questions = list(hints(triangles, found.up, scale))
    for question in questions:
        log.warning("%s: %s", file, question)
    (x, y, _), middle = high - low, np.array([*(low + high)[:2] / 2, floor_m])
    return World(
        digest=hashlib.blake2b(f"{found.digest} {found.up} {scale!r}".encode(), digest_size=16).hexdigest(),
        map_m=(float(x), float(y)),
        quads=[],
        solids=[],
        areas=[],
        light=LIGHT,
        texels_per_m=1,
        seed=0,
        sky=SKY,
        meshes=[triangles.moved(np.eye(3), -middle)],
        contents=[
            found.content,
            f"extent: {size_of(high - low)}, read with up={found.up} and scale={scale:g}",
            f"floor: at height {floor_m + scale * found.origin[2]:.4g} m of the file"
            + (", its lowest point: nothing is level in its lower half" if level is None else ""),
        ],
        notes=found.notes + questions,
        sources=found.sources,
    )


def floor_height(triangles: Triangles) -> float | None:
    """Where in the lower half most level area lies, to 5 cm; None where nothing is level."""
    (_, _, low), (_, _, high) = triangles.bounds
    z, area = triangles.corners[..., 2].mean(axis=1), triangles.twice_areas
    floor = (np.abs(triangles.normals[:, 2]) > 0.95 * area) & (z <= (low + high) / 2)
    if not floor.any():
        return None
    bins = np.floor((z[floor] - low) / 0.05).astype(int)
    highest = np.argmax(np.bincount(bins, area[floor]))
    inside = bins == highest
    return float(np.average(z[floor][inside], weights=area[floor][inside]))
