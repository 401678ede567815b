"""Lint of a world: warnings, which name the objects, about what may be wrong though it can be rendered."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from omnilab.api import Floats
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.scene.meshes.hints import unit_of_areas
from omnilab_mirror.scene.quads import Quad, Solid
from omnilab_mirror.scene.world import World

HEIGHT_M = 1.0
SAME_PLANE_M = 0.002  # nearer than this, two quads shine through each other
OVERLAP_M = 0.02  # quads and solids that touch overlap by less
RIGHT_DEG = (45, 90, 135, 180, 270)  # asked about where they are given in radians
OPEN_M = 500.0  # an area as high as this has no ceiling


def warnings_of(world: World) -> Iterator[str]:
    """The warnings, one sentence each."""
    if question := unit_of_areas(world.areas):
        yield question
    yield from _turns(world)
    yield from _areas(world)
    yield from _lamps(world)
    yield from _outside(world)
    yield from _in_walls(world)
    yield from _paths(world)
    yield from _same_plane(world)


def _areas(world: World) -> Iterator[str]:
    if not world.areas and world.meshes:
        return  # outside a mesh there is no floor, which is seen without an area
    if not world.areas:
        yield "there is no room and no area, so viewpoints may be anywhere; add one"
        return
    low, high = _bounds(world)
    for axis, side in zip("xy", world.map_m, strict=True):
        i = "xy".index(axis)
        if -side / 2 < low[i] or side / 2 > high[i]:
            yield f"map_m is {side:g} m in {axis}, from {-side / 2:g} to {side / 2:g}, but there is floor from {low[i]:g} to {high[i]:g} only"


def _turns(world: World) -> Iterator[str]:
    """Angles that are round in radians, and as degrees are next to nothing."""
    for solid in world.solids:
        degrees = float(np.rad2deg(solid.place.turn_rad))
        if meant := next((whole for whole in RIGHT_DEG if abs(abs(degrees) - np.deg2rad(whole)) < 2e-3), None):
            yield f"'{solid.name}' has turn_deg={degrees:.4g}; if that is in radians, write {np.sign(degrees) * meant:g}"


def _lamps(world: World) -> Iterator[str]:
    glowing = {quad.name for quad in world.quads if quad.paint.glows}
    for lamp in world.light.lamps:
        for solid in world.solids:
            if solid.name not in glowing and solid.holds(lamp.at[None], 0)[0]:
                yield f"the lamp '{lamp.name}' at {lamp.at.tolist()} is inside '{solid.name}', which keeps its light in"
    if world.light.ambient == 0 and not world.light.lamps:
        yield "there is neither ambient light nor a lamp, so that everything is black"


def _outside(world: World) -> Iterator[str]:
    """Where all areas have ceilings, what is not wholly in one of them."""
    if not world.areas or any(area.high[2] - area.low[2] > OPEN_M for area in world.areas):
        return
    corners: dict[tuple[int, str], list[Floats]] = {}
    for quad in world.quads:
        corners.setdefault((quad.seed[0], quad.name), []).extend(_corners(quad))
    for (_, name), points in corners.items():
        inside = np.any([area.holds(np.array(points), -0.01) for area in world.areas], axis=0)
        if not inside.all():
            where = f"near {np.round(points[int(np.argmin(inside))], 2).tolist()}"
            yield f"'{name}' {'sticks through a wall' if inside.any() else 'lies outside every room'}, {where}"


def _in_walls(world: World) -> Iterator[str]:
    walls = [solid for solid in world.solids if solid.name == "wall"]
    for solid in world.solids:
        if solid.name not in {"wall", "pillar"} and any(_overlap(solid, wall) for wall in walls):
            yield f"'{solid.name}' at {np.round(solid.place.at, 2).tolist()} sticks into a wall"


def _paths(world: World) -> Iterator[str]:
    for name, path in world.paths.items():
        T = path.poses(HEIGHT_M)
        found = [(i, why) for i, why in enumerate(obstacles(world, T[:, :3, 3], on_floor=True)) if why]
        if found:
            i, why = found[0]
            x, y = T[i, :2, 3]
            yield f"path '{name}': {len(found)} of {len(T)} images are not free, the first at ({x:.2f}, {y:.2f}), {why}"


def _same_plane(world: World) -> Iterator[str]:
    """Pairs of quads that face the same side in one plane, and overlap: which one is seen changes from pixel to pixel."""
    normals = np.array([np.cross(quad.u, quad.v) for quad in world.quads]).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.einsum("fi,fi->f", normals, np.array([quad.corner for quad in world.quads]).reshape(-1, 3))
    on_floor = normals[:, 2] < -0.999  # seen by nobody
    on_floor &= np.isin(np.round(-offsets, 3), [round(float(area.low[2]), 3) for area in world.areas])
    alike = (normals @ normals.T > 1 - 1e-6) & (np.abs(offsets[:, None] - offsets) < SAME_PLANE_M)
    reported = set()
    for i, j in zip(*np.nonzero(np.triu(alike & ~on_floor, 1)), strict=True):
        one, other = world.quads[i], world.quads[j]
        pair = (one.name, other.name)
        if one.seed[0] != other.seed[0] and pair not in reported and _quads_overlap(one, other):
            reported.add(pair)
            middle = np.round(other.corner + (other.u + other.v) / 2, 2).tolist()
            yield f"faces of '{one.name}' and '{other.name}' lie in one plane near {middle} and shine through each other"


def _bounds(world: World) -> tuple[Floats, Floats]:
    return (
        np.min([area.low for area in world.areas], axis=0),
        np.max([area.high for area in world.areas], axis=0),
    )


def _corners(quad: Quad) -> list[Floats]:
    return [quad.corner, quad.corner + quad.u, quad.corner + quad.v, quad.corner + quad.u + quad.v]


def _quads_overlap(one: Quad, other: Quad) -> bool:
    """By the separating axes of two parallelograms in one plane."""
    normal = np.cross(one.u, one.v)
    axes = [np.cross(normal, edge) for quad in (one, other) for edge in (quad.u, quad.v)]
    return _meet(np.array(_corners(one)), np.array(_corners(other)), axes)


def _overlap(one: Solid, other: Solid) -> bool:
    """By the separating axes of two upright boxes."""
    axes = [solid.place.rotation[:, i] for solid in (one, other) for i in (0, 1)]
    return _meet(_box(one), _box(other), [*axes, np.array([0, 0, 1.0])])


def _box(solid: Solid) -> Floats:
    corners = np.array([[(solid.low, solid.high)[k >> i & 1][i] for i in range(3)] for k in range(8)])
    return np.asarray(solid.place.at + corners @ solid.place.rotation.T)


def _meet(one: Floats, other: Floats, axes: list[Floats]) -> bool:
    for axis in axes:
        a, b = one @ axis / np.linalg.norm(axis), other @ axis / np.linalg.norm(axis)
        if min(a.max(), b.max()) - max(a.min(), b.min()) < OVERLAP_M:
            return False
    return True
