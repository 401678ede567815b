"""Translation scale from matched points of the ground plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Floats

LOWEST = 0.2  # sine of the angle below the horizon: nearer to it, points lie too far
LEAST = 5  # inliers
# of the highest density: the shortest length that is denser is the floor's, the densest may be a table's or a wall's
FLOOR_SHARE = 0.25
REACH = 2.0  # standard deviations within which points lie at one length; farther, clutter on the floor creeps in
UNEVEN = 0.012  # of the length: what its standard deviation is at least, from resampling and the floor (measured)


class GroundStep(NamedTuple):
    """The length of a translation in heights of the camera above the floor, NaN where its estimate failed."""

    length: float
    variance: float
    points: int  # inliers
    failed: str = ""


def ground_step(p: Floats, q: Floats, phi: float, beta: float, noise_rad: float) -> GroundStep:
    """The translation in camera heights, from matched directions p and q (M, 3) of which some show the floor.

    A direction below the horizon meets the floor at p_xy / -p_z. What stands above the floor by a share h of the
    camera's height moves as if the translation were longer by 1 / (1 - h), and nothing lies below: so the floor is the
    shortest length on which many points agree, not that on which most do.
    """
    back = rotated(q, phi)
    low = (p[:, 2] < -LOWEST) & (back[:, 2] < -LOWEST)
    if low.sum() < LEAST:
        return GroundStep(np.nan, np.inf, int(low.sum()), f"{low.sum()} points of the floor")
    t = np.array([np.cos(beta), np.sin(beta)])
    lengths, variances = _displacements(p[low], back[low], t, noise_rad)
    spread = np.sqrt(variances)
    near = (lengths[:, None] - lengths) / spread
    density = (np.exp(-0.5 * near**2) / spread).sum(axis=1)
    density[lengths <= 0] = 0
    enough = (np.abs(near) < REACH).sum(axis=0) >= LEAST  # at each length, by the points that lie there
    dense = enough & (density >= FLOOR_SHARE * density[enough].max(initial=0))
    if not dense.any():
        return GroundStep(np.nan, np.inf, 0, "no points of the floor agree")
    return _refine(lengths[dense].min(), lengths, variances, density)


def rotated(q: Floats, phi: float) -> Floats:
    """Directions (M, 3) rotated by phi about z: of a camera with heading phi, in the axes of heading 0."""
    c, s = np.cos(phi), np.sin(phi)
    return np.asarray(q @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))


def _displacements(p: Floats, back: Floats, t: Floats, noise_rad: float) -> tuple[Floats, Floats]:
    """Displacements of floor points against t (2,) and their variances, (K,) in camera heights."""
    where = [d[:, :2] / -d[:, 2:] for d in (p, back)]
    variances = np.zeros(len(p))
    for d in (p, back):
        along = (d[:, :2] @ t) ** 2 / (d[:, :2] ** 2).sum(axis=1)
        variances += noise_rad**2 * (along / d[:, 2] ** 4 + (1 - along) / d[:, 2] ** 2)
    return (where[0] - where[1]) @ t, variances


def _refine(start: float, lengths: Floats, variances: Floats, density: Floats) -> GroundStep:
    """The weighted mean of the lengths around the densest one near `start`, and its variance."""
    spread = np.sqrt(variances)
    around = np.abs(lengths - start) < REACH * spread
    length = float(lengths[around][density[around].argmax()])
    for _ in range(10):
        weight = np.where(np.abs(lengths - length) < REACH * spread, 1 / variances, 0.0)
        length = float((weight * lengths).sum() / weight.sum())
    points = int((weight > 0).sum())
    if points < LEAST or length <= 0:
        return GroundStep(np.nan, np.inf, points, f"{points} points of the floor agree")
    excess = (weight * (lengths - length) ** 2).sum() / max(points - 1, 1)
    return GroundStep(length, float(max(1.0, excess) / weight.sum() + (UNEVEN * length) ** 2), points)
