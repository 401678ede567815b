"""Translation scale from pictures of the floor as seen straight from above, tile by tile.

Lengths are in heights of the camera above the floor. Faint textures serve here, of which no feature is found: a floor of plain
planks, say, between shelves full of books.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Bools, Bytes, CalibratedCamera, Floats
from omnilab_appearance.common.ground_scale import UNEVEN, GroundStep

REACH = 1.5  # half the side of a floor picture
SIDE = 200  # pixels of it
ALONG, ACROSS = 300, 200  # pixels of it once turned, along and across the motion
STEP = 2 * REACH / ALONG  # length of a pixel along the motion
LONGEST = 60  # pixels along the motion: the longest translation
TILES = 10  # along each side
SMOOTH = 0.12  # standard deviation of what is taken for shading and subtracted
NOISE = 4.0  # grey levels squared: a variance below is no texture
FULL = 0.6  # of a tile's pixels: at least so many are seen in both pictures
ALIKE, CLEAR = 0.6, 0.1  # least correlation of a tile, and by how much it is above that of other lengths
OTHER = 0.15  # of the length: lengths farther off are others
TOGETHER = 0.06  # of the length: tiles this near each other have the same
LEAST = 4  # tiles that have the same length
SHARE = 0.25  # of the most tiles of one length


def floor_pictures(images: Bytes, camera: CalibratedCamera) -> Bytes:
    """The floor (N, SIDE, SIDE) around the camera in images (N, H, W), right is +x, up is +y; 0 where it is not shown."""
    import cv2

    u, v, shown = _maps(camera)  # type: ignore[arg-type]  # cameras are frozen dataclasses
    pictures = np.stack([cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for image in images])
    return np.where(shown, np.maximum(pictures, 1), 0).astype(np.uint8)


def floor_step(before: Bytes, now: Bytes, phi: float, beta: float) -> GroundStep:
    """The length of a translation in direction `beta` with a rotation `phi`, from floor pictures (SIDE, SIDE) of both ends.

    Each tile that correlates clearly best at one length has that length. What stands on the floor moves as if the
    translation were longer, and nothing lies below: it is the shortest length on which several tiles agree.
    """
    lengths = _tile_lengths(_turned(before, beta), _turned(now, beta - phi))
    near = np.abs(lengths[:, None] - lengths) < TOGETHER * lengths
    count = near.sum(axis=0)
    enough = count >= max(LEAST, SHARE * count.max(initial=0))
    if not enough.any():
        return GroundStep(np.nan, np.inf, int(count.max(initial=0)), f"{count.max(initial=0)} tiles of the floor agree")
    shortest = lengths[enough].min()
    around = np.flatnonzero(np.abs(lengths - shortest) < TOGETHER * shortest)
    own = lengths[near[:, around[count[around].argmax()]]]
    length = float(np.median(own))
    variance = float(np.var(own)) / len(own) + (UNEVEN * length) ** 2
    return GroundStep(length, variance, len(own))


@lru_cache(maxsize=8)
def _maps(camera: CalibratedCamera) -> tuple[Floats, Floats, Bools]:
    """Where a camera shows the pixels of its floor picture, u and v (SIDE, SIDE), and whether it does."""
    x, y = np.meshgrid(*[(np.arange(SIDE) - (SIDE - 1) / 2) * 2 * REACH / SIDE] * 2)
    at = camera.pixels(np.stack([x, -y, -np.ones_like(x)], -1))
    with np.errstate(invalid="ignore"):
        shown: Bools = np.asarray(((at > -0.5) & (at < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1))
    u, v = np.moveaxis(np.where(np.isfinite(at), at, -1e4), -1, 0).astype(np.float32)
    return np.ascontiguousarray(u), np.ascontiguousarray(v), shown


def _turned(picture: Bytes, angle: float) -> Floats:
    """A floor picture with x along `angle`, (ACROSS, ALONG), of even brightness and contrast; NaN where it is not shown."""
    import cv2

    x, y = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * 2 * REACH / n for n in (ALONG, ACROSS)))
    c, s = np.cos(angle), np.sin(angle)
    scale = SIDE / (2 * REACH)
    u, v = ((c * x + s * y) * scale + (SIDE - 1) / 2, (c * y - s * x) * scale + (SIDE - 1) / 2)
    turned = cv2.remap(picture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    shown = (
        cv2.remap((picture > 0).astype(np.float32), u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR) > 0.99
    )
    sigmas = (SMOOTH / (2 * REACH) * ALONG, SMOOTH / (2 * REACH) * ACROSS)
    rest = turned.astype(np.float32) - cv2.GaussianBlur(turned.astype(np.float32), (0, 0), *sigmas)
    contrast = np.sqrt(cv2.GaussianBlur(rest**2, (0, 0), *sigmas) + NOISE)
    return np.where(shown, rest / contrast, np.nan)


def _tile_lengths(before: Floats, now: Floats) -> Floats:
    """The length (K,) of each tile in which one stands out."""
    scores = np.stack([_correlations(before, now, shift) for shift in range(LONGEST + 1)])
    scores = scores[:, np.isfinite(scores).all(axis=0)]
    best, tile = scores.argmax(axis=0), np.arange(scores.shape[1])
    shift = np.arange(len(scores))[:, None]
    others = np.where(np.abs(shift - best) > np.maximum(OTHER * best, 2), scores, -1).max(axis=0)
    top = scores[best, tile]
    clear = (best > 0) & (best < LONGEST) & (top > ALIKE) & (others < top - CLEAR)
    best, tile, top = best[clear], tile[clear], top[clear]
    left, right = scores[best - 1, tile], scores[best + 1, tile]
    return np.asarray(STEP * (best + 0.5 * (left - right) / (left - 2 * top + right)))


def _correlations(before: Floats, now: Floats, shift: int) -> Floats:
    """The correlation of each tile (TILES * TILES,) after a translation of so many pixels; NaN of tiles hardly seen."""
    moved = np.full_like(now, np.nan)
    moved[:, shift:] = now[:, : ALONG - shift]
    both = np.isfinite(before) & np.isfinite(moved)
    a, b = np.where(both, before, 0), np.where(both, moved, 0)
    sums = [_tiles(each) for each in (a * b, a * a, b * b, both.astype(np.float32))]
    full = sums[3] >= FULL * (ALONG // TILES) * (ACROSS // TILES)
    return np.where(full, sums[0] / np.sqrt(sums[1] * sums[2] + 1e-6), np.nan)


def _tiles(values: Floats) -> Floats:
    """Sums (TILES * TILES,) of values (ACROSS, ALONG) over tiles."""
    return np.asarray(values.reshape(TILES, ACROSS // TILES, TILES, ALONG // TILES).sum(axis=(1, 3)).ravel())
