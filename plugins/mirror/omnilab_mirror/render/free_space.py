"""Free space: where a camera may be among solids and areas, and among meshes, which rays are cast at."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Floats, Ints
from omnilab_mirror.render.prepared_world import embree_of
from omnilab_mirror.scene.world import World

if TYPE_CHECKING:
    from omnilab_mirror.render.embree import Embree

CLEARANCE_M = 0.05
STEP_M = 0.1  # what is higher above the floor, at height 0, a robot cannot stand on
AROUND = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], float)
AROUND /= np.linalg.norm(AROUND, axis=1)[:, None]
RING = np.vstack([np.zeros(3), [(x, y, 0) for x, y in product((-1, 0, 1), repeat=2) if x or y]])
DOWN = np.array([0, 0, -1.0])
FURNITURE_M = 2.0  # what encloses a point more widely is a room
POINTS_AT_ONCE = 20_000


def obstacles(world: World, points: Floats, on_floor: bool = False) -> list[str]:
    """Obstacle at each viewpoint (N, 3): "inside 'table'", "outside the room", or "" where it is free.

    `on_floor`: a robot on the floor carries the camera, so what is below the viewpoint is an obstacle too.
    """
    found = np.full(len(points), "", object)
    for solid in world.solids:
        if on_floor:
            found[solid.is_below(points, CLEARANCE_M)] = f"above '{solid.name}'"
        found[solid.holds(points, CLEARANCE_M)] = f"inside '{solid.name}'"
    if world.areas:
        within = np.any([area.holds(points, CLEARANCE_M) for area in world.areas], axis=0)
        found[~within] = "outside " + " and ".join(sorted({f"the {area.name}" for area in world.areas}))
    if world.meshes:
        free = found == ""
        found[free] = mesh_obstacles(embree_of(world), points[free], on_floor)
    return list(found)


def mesh_obstacles(tree: Embree, points: Floats, on_floor: bool) -> list[str]:
    """Obstacle among meshes at each viewpoint (N, 3), or "": outside, near a surface, or, `on_floor`, above something."""
    parts = [points[i : i + POINTS_AT_ONCE] for i in range(0, len(points), POINTS_AT_ONCE)]
    return [why for part in parts for why in _mesh_obstacles(tree, part, on_floor)]


def _mesh_obstacles(tree: Embree, points: Floats, on_floor: bool) -> list[str]:
    below, depth, _ = _meet(tree, points + CLEARANCE_M * RING[:, None], DOWN)
    around, distance, _ = _meet(tree, points, AROUND[:, None])
    found = np.full(len(points), "", object)
    if on_floor:
        _name_mesh(found, "above", tree, np.where(points[:, 2] - depth > STEP_M, below, -1))
    _name_mesh(found, "too near to", tree, np.where(distance < CLEARANCE_M, around, -1))
    _name_mesh(found, "inside", tree, _enclosing(tree, points))
    found[below[0] < 0] = "outside: nothing is below it"
    return list(found)


def _enclosing(tree: Embree, points: Floats) -> Ints:
    """A triangle (1, N) of what encloses each point: its back is met on all sides, not far off; else -1.

    Meshes of furniture often have no bottom, and walls show their front to those inside.
    """
    level = AROUND[AROUND[:, 2] == 0]
    around, distance, backs = _meet(tree, points, level[:, None])
    name = tree.triangles.name[around]
    same = (around >= 0) & backs & (distance < FURNITURE_M) & (name == name[0])
    return np.where(same.all(axis=0), around[0], -1)[None]


def _meet(tree: Embree, points: Floats, directions: Floats) -> tuple[Ints, Floats, Bools]:
    """Which triangles (K, N) K rays from each of N points meet (-1: none), how far away, and whether from the back."""
    origins, toward = np.broadcast_arrays(points, directions)
    triangle, distance = tree.tree.meet(origins.reshape(-1, 3), toward.reshape(-1, 3))
    shape = origins.shape[:2]
    backs = np.einsum("ri,ri->r", tree.triangles.normals[triangle], toward.reshape(-1, 3)) > 0
    return triangle.reshape(shape), distance.reshape(shape), backs.reshape(shape)


def _name_mesh(found: npt.NDArray[np.object_], relation: str, tree: Embree, triangles: Ints) -> None:
    """Write into `found` (N,) which mesh the first of the triangles (K, N) belongs to; quads are not counted."""
    parts = tree.triangles
    counts = (triangles >= 0) & ~parts.painted[triangles]
    for i in np.nonzero(counts.any(axis=0))[0]:
        first = triangles[np.argmax(counts[:, i]), i]
        found[i] = f"{relation} '{parts.names[parts.name[first]]}'"
