"""Poses that a layout requests, as far as a world leaves them free."""

from __future__ import annotations

import math

import numpy as np

from omnilab.api import Floats, GridPoses, NamedPath, PathPoses, PoseRequest, RandomPoses, RecordedPoses
from omnilab.errors import DataError, did_you_mean
from omnilab.geometry import planar_poses
from omnilab.limits import check_work, hours
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.scene.world import World

MOST_POSES = 1_000_000  # drawn at random
NODE_BYTES = 250  # of a grid's node, at least: its pose, its key, the points that are tried


def poses_of(
    layout: PoseRequest, world: World, height_m: float, on_floor: bool, image_s: float = 0.0
) -> tuple[Floats, list[str]]:
    """`T_world_camera` (N, 4, 4) of a layout, and what was left out with its reason.

    `on_floor`: the poses of grids and random layouts keep clear of furniture below them, too. `image_s`: seconds that an
    image takes at least, for the sentence about a grid that is too large.
    """
    if isinstance(layout, RecordedPoses):
        raise DataError("a virtual sensor has recorded nothing; ask it for random poses, a grid with step_m or a path")
    if isinstance(layout, PathPoses):
        return _path(layout, world), []
    if isinstance(layout, NamedPath):
        return _path(PathPoses(_route(layout, world, height_m)), world), []
    extent = world.map_m if layout.extent_m is None else layout.extent_m
    height = height_m if layout.height_m is None else layout.height_m
    if isinstance(layout, RandomPoses):
        return _random(layout, world, extent, height, on_floor), []
    _check_grid(layout, extent, image_s)
    return _grid(layout, world, extent, height, on_floor)


def _check_grid(layout: GridPoses, extent: tuple[float, float], image_s: float) -> None:
    """DataError for a grid without a step; ConfigError for one that does not fit into memory."""
    if layout.step_m is None or not layout.step_m > 0:
        raise DataError(
            f"a virtual sensor needs a grid's step_m above 0, not {layout.step_m}; give step_m, and no 'every'"
        )
    count = math.prod(side / layout.step_m + 1 for side in extent)
    check_work(
        f"the {count:.3g} nodes of a grid of {extent[0]:g} x {extent[1]:g} m with step_m={layout.step_m:g} (all their"
        f" images: {hours(count * image_s)} or more)",
        "give a larger step_m or a smaller extent_m",
        memory=count * NODE_BYTES,
    )


def _grid(
    layout: GridPoses, world: World, extent: tuple[float, float], height: float, on_floor: bool
) -> tuple[Floats, list[str]]:
    """Both ends of the extent included where the step divides it, row by row, x fastest."""
    step_m = layout.step_m or math.nan  # checked before
    x, y = (-side / 2 + step_m * np.arange(int(side / step_m + 1e-6) + 1) for side in extent)
    points = np.array([(px, py, height) for py in y for px in x])
    found = obstacles(world, points, on_floor)
    omitted = [f"x={p[0]:.2f} y={p[1]:.2f}: {why}" for p, why in zip(points, found, strict=True) if why]
    free = points[[not why for why in found]]
    if len(free) == 0:
        raise DataError(
            f"none of the grid's {len(points)} nodes is free at height {height:g} m; change extent_m or height_m"
        )
    return planar_poses(free), omitted


def _random(layout: RandomPoses, world: World, extent: tuple[float, float], height: float, on_floor: bool) -> Floats:
    """Uniform over the free part of the extent."""
    if not 1 <= layout.count <= MOST_POSES:
        raise DataError(f"count={layout.count} random poses cannot be drawn; give a count from 1 to {MOST_POSES}")
    if layout.heading_step_rad is not None and not 0 < layout.heading_step_rad <= np.pi:
        raise DataError(
            f"headings that are multiples of {np.degrees(layout.heading_step_rad):g} degrees are one heading, or none; give"
            " a step above 0 and up to 180 degrees"
        )
    rng, half = np.random.default_rng(layout.seed), np.array(extent) / 2
    points = np.empty((0, 3))
    for _ in range(100):
        drawn = np.column_stack([rng.uniform(-half, half, (layout.count, 2)), np.full(layout.count, height)])
        points = np.concatenate([points, drawn[[not why for why in obstacles(world, drawn, on_floor)]]])
        if len(points) >= layout.count:
            return planar_poses(points[: layout.count], _headings(rng, layout))
    raise DataError(
        f"less than 1 % of the extent {extent[0]:g} x {extent[1]:g} m is free at height {height:g} m; change extent_m or height_m"
    )


def _headings(rng: np.random.Generator, layout: RandomPoses) -> Floats:
    if layout.heading_step_rad is None:
        return rng.uniform(0, 2 * np.pi, layout.count)
    steps = max(1, round(2 * np.pi / layout.heading_step_rad))
    return layout.heading_step_rad * rng.integers(steps, size=layout.count)


def _route(layout: NamedPath, world: World, height_m: float) -> Floats:
    if layout.name not in world.paths:
        known = ", ".join(world.paths) or "none"
        raise DataError(
            f"the world has no path '{layout.name}'; there is {known}{did_you_mean(layout.name, world.paths)}"
        )
    return world.paths[layout.name].poses(height_m if layout.height_m is None else layout.height_m)


def _path(layout: PathPoses, world: World) -> Floats:
    T = np.asarray(layout.T_world_camera, float)
    if T.ndim != 3 or T.shape[1:] != (4, 4) or not np.isfinite(T).all():
        raise DataError(f"a path of shape {T.shape} is not poses; give finite T_world_camera of shape (N, 4, 4)")
    R = T[:, :3, :3]
    if not np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-6) or np.any(np.linalg.det(R) < 0):
        raise DataError("a path's T_world_camera must hold rotations; orthonormalise their upper left 3 x 3")
    for i, why in enumerate(obstacles(world, T[:, :3, 3])):
        if why:
            x, y, z = T[i, :3, 3]
            raise DataError(f"pose {i} of the path, at ({x:.2f}, {y:.2f}, {z:.2f}) m, is {why}; move it")
    return T
