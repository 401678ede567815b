"""Pairs of images at given distances, with rotations about any axis between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Ints, Plan
from omnilab.errors import DataError
from omnilab.geometry import rotation_xyz
from omnilab_studies.common.scores import known_poses


class Pairs(NamedTuple):
    """N pairs of frames, as indices into two plans."""

    reference: Ints  # (N,)
    query: Ints  # (N,)
    distance_m: Floats  # (N,) the one of the study's that they belong to


def pairs_of(plan: Plan, distances_m: Sequence[float], count: int, slack_m: float, rng: np.random.Generator) -> Pairs:
    """`count` pairs of a plan's frames for each distance, drawn at random; all where there are fewer.

    A pair belongs to a distance if its own is at most `slack_m` from it; at distance 0 a frame may be its own pair.
    DataError if a distance has none.
    """
    at = known_poses(plan.T_world_camera, "images")[:, :3, 3]
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    found = []
    for distance_m in distances_m:
        fits = np.argwhere(np.abs(apart - distance_m) <= slack_m)
        if distance_m > 0:
            fits = fits[fits[:, 0] != fits[:, 1]]
        if len(fits) == 0:
            raise DataError(
                f"no two of the {len(at)} images are {distance_m:g} m apart, give or take {slack_m:g}; give other"
                " study.distances_m, or a larger study.slack_m"
            )
        chosen = fits[np.sort(rng.choice(len(fits), min(count, len(fits)), replace=False))]
        found.append(np.column_stack([chosen, np.full(len(chosen), distance_m)]))
    every = np.concatenate(found)
    return Pairs(every[:, 0].astype(int), every[:, 1].astype(int), every[:, 2])


def random_rotations(count: int, largest_tilt_rad: float, rng: np.random.Generator) -> Floats:
    """Rotations (count, 3, 3) of any heading that tilt the z axis by at most an angle, evenly over where it may point.

    With pi they are uniform on SO(3).
    """
    tilt = np.arccos(rng.uniform(np.cos(largest_tilt_rad), 1, count))
    azimuth, heading = rng.uniform(0, 2 * np.pi, (2, count))
    return np.asarray(rotation_xyz(0, 0, azimuth) @ rotation_xyz(0, tilt, heading - azimuth))


def heading_and_tilt(R: Floats) -> tuple[Floats, Floats]:
    """The heading (...) of rotations (..., 3, 3), which is the twist about z, and how far (...) they tilt the z axis."""
    heading = np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])
    return heading, np.arctan2(np.hypot(R[..., 0, 2], R[..., 1, 2]), R[..., 2, 2])


def angle_of(R: Floats) -> Floats:
    """The angles (...) of rotations (..., 3, 3)."""
    sine = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    return np.asarray(np.arctan2(np.linalg.norm(sine, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1))
