"""A small room, drawn with numpy alone: what the conformance checks show to components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from omnilab.api import (
    Bools,
    Bytes,
    Floats,
    Frames,
    GridPoses,
    Mesh,
    NamedPath,
    PathPoses,
    Plan,
    PoseRequest,
    RandomPoses,
)
from omnilab.cameras import HyperbolicMirror
from omnilab.geometry import planar_poses

LOW, HIGH = np.array([-3.0, -2.5, 0.0]), np.array([3.0, 2.5, 2.6])  # metres
TEXELS, METRES_PER_TEXEL = 256, 0.03
BATCH = 32


@dataclass
class SmallRoom:
    """A room of 6 x 5 x 2.6 m with patterned walls, as a hyperbolic mirror sees it: a virtual sensor for tests.

    Any pose can be imaged. As a recording, and as any path by name, it is a closed path of 24 images.
    """

    size: int = 250  # pixels a side
    color: bool = False
    height_m: float = 1.0  # of the viewpoint above the floor

    def plan(self, layout: PoseRequest) -> Plan:
        """The poses of a layout."""
        T = self._poses(layout)
        return Plan([f"room {self.size} {self.color} {pose.tobytes().hex()}" for pose in T], T)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned images, in batches."""
        assert plan.T_world_camera is not None
        for start in range(0, len(plan), BATCH):
            rows = np.arange(start, min(start + BATCH, len(plan)))
            T = plan.T_world_camera[rows]
            images = np.stack([self._image(pose) for pose in T])
            yield Frames(images, list(plan.keys[start : start + BATCH]), rows * 100_000_000, self.camera, rows, T)

    def scene(self) -> Mesh | None:
        """Nothing."""
        return None

    @property
    def camera(self) -> HyperbolicMirror:
        return HyperbolicMirror(self.size, crop=0.5)

    def _poses(self, layout: PoseRequest) -> Floats:
        if isinstance(layout, PathPoses):
            return layout.T_world_camera
        if isinstance(layout, GridPoses):
            x, y = (_spread(half, layout.step_m or 1.0) for half in self._half(layout))
            return planar_poses(self._at(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2), layout.height_m))
        if isinstance(layout, RandomPoses):
            rng = np.random.default_rng(layout.seed)
            heading, step = rng.uniform(-np.pi, np.pi, layout.count), layout.heading_step_rad
            heading = heading if step is None else step * np.round(heading / step)
            at = rng.uniform(-1, 1, (layout.count, 2)) * self._half(layout)
            return planar_poses(self._at(at, layout.height_m), heading)
        angle = np.linspace(0, 2 * np.pi, 24)
        height_m = layout.height_m if isinstance(layout, NamedPath) else None
        return planar_poses(self._at(np.column_stack([np.cos(angle), np.sin(angle)]), height_m), angle + np.pi / 2)

    def _at(self, xy: Floats, height_m: float | None = None) -> Floats:
        return np.column_stack([xy, np.full(len(xy), self.height_m if height_m is None else height_m)])

    def _half(self, layout: Any) -> Floats:
        """Half of the extent of x and of y."""
        return np.asarray(layout.extent_m or (4.0, 3.0)) / 2

    def _image(self, T_world_camera: Floats) -> Bytes:
        rays, seen = _rays(self.size)
        direction, at = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
        with np.errstate(divide="ignore"):
            apart = np.maximum((LOW - at) / direction, (HIGH - at) / direction)  # along each axis, to the face ahead
        axis = apart.argmin(axis=-1)
        hit = at + direction * apart.min(axis=-1)[..., None]
        face = 2 * axis + (np.take_along_axis(direction, axis[..., None], -1)[..., 0] > 0)
        across = np.where(axis == 0, hit[..., 1], hit[..., 0])
        up = np.where(axis == 2, hit[..., 1], hit[..., 2])
        i, j = (np.floor(value / METRES_PER_TEXEL).astype(int) % TEXELS for value in (up, across))
        values = _textures()[face, i, j] * seen
        sampled = values.reshape(self.size, 2, self.size, 2, 3).mean(axis=(1, 3))
        return np.asarray(np.rint(sampled if self.color else sampled[..., 0]), np.uint8)


def _spread(half_m: float, step_m: float) -> Floats:
    """Positions every step, as many as lie within both ends, around 0."""
    count = int(np.floor(2 * half_m / step_m + 1e-9)) + 1
    return (np.arange(count) - (count - 1) / 2) * step_m


@lru_cache(maxsize=4)
def _rays(size: int) -> tuple[Floats, Bools]:
    """Directions (2 size, 2 size, 3) of four samples a pixel, and which of them show the room."""
    v, u = (np.indices((2 * size, 2 * size)) - 0.5) / 2
    rays = HyperbolicMirror(size, crop=0.5).directions(np.stack([u, v], -1))
    seen = np.isfinite(rays).all(axis=-1, keepdims=True)
    return np.where(seen, rays, [0, 0, 1.0]), np.asarray(seen)


@lru_cache(maxsize=1)
def _textures() -> Bytes:
    """Blocks of several sizes for each of the six faces (6, TEXELS, TEXELS, 3)."""
    rng = np.random.default_rng(6)
    total = np.zeros((6, TEXELS, TEXELS, 3))
    for side, weight in ((32, 1.0), (8, 0.7), (3, 0.5)):
        cells = -(-TEXELS // side)
        blocks = rng.uniform(-1, 1, (6, cells, cells, 1)) + 0.3 * rng.uniform(-1, 1, (6, cells, cells, 3))
        total += weight * blocks.repeat(side, 1).repeat(side, 2)[:, :TEXELS, :TEXELS]
    return np.clip(128 + 70 * total, 0, 255).astype(np.uint8)
