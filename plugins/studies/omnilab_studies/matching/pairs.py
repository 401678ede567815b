"""Pairs of images at given distances, and which of their matches agree with the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, CalibratedCamera, Floats, Ints
from omnilab.errors import DataError

WITHIN = 0.1  # of the distance: so much nearer or farther apart two images may be


class Pair(NamedTuple):
    """Two images of a plan, and the distance that they stand for."""

    distance_m: float
    before: int
    now: int


def pairs_at(position_m: Floats, distances_m: list[float], count: int) -> list[Pair]:
    """`count` pairs of positions (N, 3) for each distance, those nearest to it; none is in two pairs of one distance.

    DataError if fewer are within a tenth of the distance.
    """
    apart = np.linalg.norm(position_m[:, None] - position_m, axis=-1)
    apart[np.tril_indices(len(apart))] = np.nan
    return [pair for distance in distances_m for pair in _pairs(apart, distance, count)]


def _pairs(apart_m: Floats, distance_m: float, count: int) -> list[Pair]:
    off = np.abs(apart_m - distance_m)
    order = np.argsort(off, axis=None, kind="stable")[: int((off <= WITHIN * distance_m).sum())]
    chosen, taken = list[Pair](), set[int]()
    for before, now in np.column_stack(np.unravel_index(order, apart_m.shape)).tolist():
        if len(chosen) < count and not {before, now} & taken:
            chosen.append(Pair(distance_m, before, now))
            taken |= {before, now}
    if len(chosen) < count:
        raise DataError(
            f"{len(chosen)} of study.pairs={count} pairs of images are {distance_m:g} m apart, give or take"
            f" {WITHIN:.0%}; give a larger study.images, fewer pairs, or another of study.distances_m"
        )
    return chosen


def relative(T_world_before: Floats, T_world_now: Floats) -> tuple[Floats, Floats]:
    """Rotation (3, 3) and translation (3,) that take points of the second camera's frame to the first's."""
    T = np.linalg.inv(T_world_before) @ T_world_now
    return T[:3, :3], T[:3, 3]


def agrees(p: Floats, q: Floats, R: Floats, t: Floats, tolerance_rad: float) -> Bools:
    """Which matched directions p, q (M, 3) one point can have, seen from two cameras of known relative pose.

    Both lie in one plane with the translation, on one side of it, and the point is no nearer to the translation's
    direction from where it starts than from where it ends: each within the tolerance.
    """
    t, back = t / np.linalg.norm(t), q @ R.T
    normal = np.cross(t, back)
    sine = np.linalg.norm(normal, axis=1)
    off = np.abs((p * normal).sum(axis=1)) / np.maximum(sine, 1e-12)
    beside = (np.cross(t, p) * normal).sum(axis=1) > 0
    ahead = np.arccos(np.clip(p @ t, -1, 1)) <= np.arccos(np.clip(back @ t, -1, 1)) + tolerance_rad
    return np.asarray((off < np.sin(tolerance_rad)) & beside & ahead)


def planar_direction(p: Floats, q: Floats, rotation_rad: float) -> float:
    """The direction of a planar translation on which matched directions p, q (M, 3) agree, after a known rotation.

    It lies in the plane of each match, and what is seen moves away from it.
    """
    c, s = np.cos(rotation_rad), np.sin(rotation_rad)
    back = q @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    t = np.linalg.svd(np.cross(p, back)[:, :2])[2][-1]
    away = ((p - back)[:, :2] @ t).sum() >= 0
    return float(np.arctan2(*(t if away else -t)[::-1]))


def looking(camera: CalibratedCamera, azimuth_level: Floats) -> Floats:
    """Unit directions (M, 3) of azimuths and levels (M, 2) of a camera's panorama."""
    return camera.directions(camera.unwrap(azimuth_level[:, 0], azimuth_level[:, 1]))


def images_of(pairs: list[Pair]) -> Ints:
    """The images (K,) of a plan that are in any of the pairs, in order."""
    return np.unique([image for pair in pairs for image in (pair.before, pair.now)])
