"""The deck of the robot that carries a camera, as the camera sees it: at the same place in every image."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.cameras import RayCamera
from omnilab_mirror.render.rays import rays_of

SEED = 0  # of what stands on the deck
THINGS = 40  # boxes and cables, seen from above


def with_deck(images: Bytes, camera: RayCamera, samples: int, radius_m: float, below_m: float) -> Bytes:
    """Images (N, H, W[, 3]) with a round deck below the viewpoint, level with the camera; they are changed in place.

    It hides what is behind it, and casts no shadow. Pixels at its rim mix it with the room by the share of their rays.
    """
    share, grey = _deck(camera, samples, radius_m, below_m)
    at = share > 0
    weight, seen = share[at], (share * grey)[at]
    if images.ndim == 4:
        weight, seen = weight[:, None], seen[:, None]
    images[:, at] = np.rint((1 - weight) * images[:, at] + seen).astype(np.uint8)
    return images


@lru_cache(maxsize=4)
def _deck(camera: RayCamera, samples: int, radius_m: float, below_m: float) -> tuple[Floats, Floats]:
    """The share of each pixel's rays that meet the deck (H, W), and their mean grey (H, W)."""
    found = rays_of(camera, samples)
    direction = found.rays[..., :3].astype(np.float64)
    start = np.zeros(3) if found.starts is None else found.starts
    down = direction[..., 2] < 0
    along = np.divide(-below_m - np.broadcast_to(start, direction.shape)[..., 2], direction[..., 2], where=down,
                      out=np.zeros(down.shape))  # fmt: skip
    x, y = np.moveaxis((start + along[..., None] * direction)[..., :2], -1, 0)
    hit = down & (along > 0) & (np.hypot(x, y) <= radius_m)
    count = hit.sum(axis=-1)
    grey = np.where(hit, _grey(x / radius_m, y / radius_m), 0).sum(axis=-1)
    return count / samples, np.divide(grey, count, where=count > 0, out=np.zeros(count.shape))


def _grey(x: Floats, y: Floats) -> Floats:
    """Grey values of the deck, where 1 is its radius: a plate with rectangles of any size, direction and grey."""
    rng = np.random.default_rng(SEED)
    grey = np.full(x.shape, 70.0)
    for _ in range(THINGS):
        (u, v), turn, half = rng.uniform(-0.8, 0.8, 2), rng.uniform(0, np.pi), rng.uniform(0.02, 0.2, 2)
        a = (x - u) * np.cos(turn) + (y - v) * np.sin(turn)
        b = (y - v) * np.cos(turn) - (x - u) * np.sin(turn)
        grey[(np.abs(a) < half[0]) & (np.abs(b) < half[1])] = rng.uniform(0, 255)
    return grey
