"""Where a camera may be among meshes, found by rays."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints
from omnilab_mirror.render.embree import Embree

STEP_M = 0.1  # what is higher above the floor, at height 0, a robot cannot stand on
AROUND = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], float)
AROUND /= np.linalg.norm(AROUND, axis=1)[:, None]
RING = np.vstack([np.zeros(3), [(x, y, 0) for x, y in product((-1, 0, 1), repeat=2) if x or y]])
DOWN = np.array([0, 0, -1.0])
FURNITURE_M = 2.0  # what encloses a point more widely is a room
POINTS_AT_ONCE = 20_000


def mesh_obstacles(embree: Embree, points: Floats, on_floor: bool, clearance_m: float) -> list[str]:
    """What each viewpoint (N, 3) is in the way of, or "": outside, near a surface, or, `on_floor`, above something."""
    parts = [points[i : i + POINTS_AT_ONCE] for i in range(0, len(points), POINTS_AT_ONCE)]
    return [why for part in parts for why in _obstacles(embree, part, on_floor, clearance_m)]


def _obstacles(embree: Embree, points: Floats, on_floor: bool, clearance_m: float) -> list[str]:
    below, depth, _ = _meet(embree, points + clearance_m * RING[:, None], DOWN)
    around, distance, _ = _meet(embree, points, AROUND[:, None])
    found = np.full(len(points), "", object)
    if on_floor:
        _tell(found, "above", embree, np.where(points[:, 2] - depth > STEP_M, below, -1))
    _tell(found, "too near to", embree, np.where(distance < clearance_m, around, -1))
    _tell(found, "inside", embree, _enclosing(embree, points))
    found[below[0] < 0] = "outside: nothing is below it"
    return list(found)


def _enclosing(embree: Embree, points: Floats) -> Ints:
    """A triangle (1, N) of what encloses each point: its back is met on all sides, not far off; else -1.

    Meshes of furniture often have no bottom, and walls show their front to those inside.
    """
    level = AROUND[AROUND[:, 2] == 0]
    around, distance, backs = _meet(embree, points, level[:, None])
    name = embree.triangles.name[around]
    same = (around >= 0) & backs & (distance < FURNITURE_M) & (name == name[0])
    return np.where(same.all(axis=0), around[0], -1)[None]


def _meet(embree: Embree, points: Floats, directions: Floats) -> tuple[Ints, Floats, npt.NDArray[np.bool_]]:
    """Which triangles (K, N) K rays from each of N points meet (-1: none), how far away, and whether from the back."""
    origins, toward = np.broadcast_arrays(points, directions)
    met = embree.meet(origins.reshape(-1, 3), toward.reshape(-1, 3))
    shape = origins.shape[:2]
    backs = np.einsum("ri,ri->r", embree.triangles.normals[met["primID"]], toward.reshape(-1, 3)) > 0
    return met["primID"].reshape(shape), met["tfar"].reshape(shape), backs.reshape(shape)


def _tell(found: npt.NDArray[np.object_], relation: str, embree: Embree, triangles: Ints) -> None:
    """Write into `found` (N,) which mesh the first of the triangles (K, N) belongs to; faces are not the meshes' business."""
    parts = embree.triangles
    counts = (triangles >= 0) & ~parts.painted[triangles]
    for i in np.nonzero(counts.any(axis=0))[0]:
        first = triangles[np.argmax(counts[:, i]), i]
        found[i] = f"{relation} '{parts.names[parts.name[first]]}'"
