"""Rays of a camera's pixels, and bounding cones around tiles of pixels."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats
from omnilab.cameras import CentralCamera, RayCamera
from omnilab.limits import check_work
from omnilab_mirror.render.tracer import BLOCK, TILE, Cones

RAY_BYTES = 200  # while rays are made, at least
NO_CONE = (-2.0, 2.0)  # a tile that spans more than a half-space may see anything


class Rays(NamedTuple):
    """All rays of a camera, in its frame."""

    rays: Floats  # (H, W, S, 4): unit direction, and the pixel's solid angle there; zeros where the mirror ends
    starts: Floats | None  # (H, W, S, 3): where they start, in metres; None: in the viewpoint
    blocks: Cones
    tiles: Cones


@lru_cache(maxsize=4)
def rays_of(camera: RayCamera, samples: int) -> Rays:
    """The rays of a camera with `samples` = n x n points in each pixel."""
    check_work(
        f"the rays of an image of {camera.width} x {camera.height} pixels, {samples} a pixel,",
        "give a smaller image, or fewer sensor.samples",
        memory=RAY_BYTES * samples * camera.width * camera.height,
    )
    n = int(np.sqrt(samples))
    offset = (np.arange(n) + 0.5) / n - 0.5
    v, u, dv, du = np.meshgrid(np.arange(camera.height), np.arange(camera.width), offset, offset, indexing="ij")
    uv = np.stack([u + du, v + dv], -1).reshape(camera.height, camera.width, samples, 2)
    directions = camera.directions(uv)
    rays = np.concatenate([directions, _solid_angle(camera, uv)[..., None]], -1)
    rays = np.nan_to_num(rays, nan=0.0)
    starts = None if isinstance(camera, CentralCamera) else np.nan_to_num(camera.origins(uv), nan=0.0)
    return Rays(rays, starts, _cones(rays, starts, BLOCK), _cones(rays, starts, TILE))


def _solid_angle(camera: RayCamera, uv: Floats) -> Floats:
    """Steradians that a pixel at `uv` covers."""
    h = 1e-3
    right, up = np.array([h, 0]), np.array([0, h])
    along_u = camera.directions(uv + right) - camera.directions(uv - right)
    along_v = camera.directions(uv + up) - camera.directions(uv - up)
    return np.asarray(np.linalg.norm(np.cross(along_u, along_v), axis=-1)) / (2 * h) ** 2


def _cones(rays: Floats, starts: Floats | None, side: int) -> Cones:
    shape = (-(-rays.shape[0] // side), -(-rays.shape[1] // side))
    axis, spread, around = np.zeros((*shape, 3)), np.zeros((*shape, 2)), np.zeros(shape)
    for v, u in np.ndindex(shape):
        square = slice(v * side, (v + 1) * side), slice(u * side, (u + 1) * side)
        d = rays[square][..., :3].reshape(-1, 3)
        axis[v, u], spread[v, u] = _cone(d[np.any(d != 0, axis=1)])
        if starts is not None:
            around[v, u] = np.linalg.norm(starts[square], axis=-1).max() + 1e-6  # never 0: that means a viewpoint
    return Cones(axis, spread, around)


def _cone(d: Floats) -> tuple[Floats, tuple[float, float]]:
    if len(d) == 0:
        return np.zeros(3), (1.0, 0.0)
    axis = d.sum(0) / max(float(np.linalg.norm(d.sum(0))), 1e-12)
    sin = float(np.linalg.norm(np.cross(d, axis), axis=1).max()) + 1e-9
    return axis, (float(np.sqrt(1 - sin**2)), sin) if (d @ axis).min() > 0.1 else NO_CONE
