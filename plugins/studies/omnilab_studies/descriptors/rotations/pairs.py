"""Pairs of images at given distances, with rotations about any axis between them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Ints, Plan
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import rotation_xyz
from omnilab_studies.common.scores import known_poses

LONGEST_PATTERN = 300  # characters


class Pairs(NamedTuple):
    """N pairs of frames, as indices into two plans."""

    reference: Ints  # (N,)
    query: Ints  # (N,)
    distance_m: Floats  # (N,) the one of the study's that they belong to


def pairs_of(
    plan: Plan, distances_m: Sequence[float], count: int, slack_m: float, rng: np.random.Generator,
    rooms: Sequence[str] | None = None, once: bool = False,
) -> Pairs:  # fmt: skip
    """`count` pairs of a plan's N frames for each distance, drawn at random; all where there are fewer.

    A pair belongs to a distance if its own is at most `slack_m` from it; at distance 0 a frame may be its own pair. Both
    are of one room, where `rooms` (N,) names each frame's. `once`: two frames are a pair once, and not either way.
    DataError if a distance has none.
    """
    at = known_poses(plan.T_world_camera, "images")[:, :3, 3]
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    if rooms is not None:
        apart[np.asarray(rooms)[:, None] != np.asarray(rooms)] = np.inf
    if once:
        apart[np.tril_indices(len(at), -1)] = np.inf
    found = []
    for distance_m in distances_m:
        fits = np.argwhere(np.abs(apart - distance_m) <= slack_m)
        if distance_m > 0:
            fits = fits[fits[:, 0] != fits[:, 1]]
        if len(fits) == 0:
            raise DataError(
                f"no two of the {len(at)} images{' of one room (study.room)' * (rooms is not None)} are {distance_m:g} m apart, give"
                f" or take {slack_m:g}; give other study.distances_m, or a larger study.slack_m"
            )
        chosen = fits[np.sort(rng.choice(len(fits), min(count, len(fits)), replace=False))]
        found.append(np.column_stack([chosen, np.full(len(chosen), distance_m)]))
    every = np.concatenate(found)
    return Pairs(every[:, 0].astype(int), every[:, 1].astype(int), every[:, 2])


def rooms_of(names: Sequence[str], pattern: str) -> list[str]:
    """What a regular expression matches in the name of each image (N,); ConfigError if it is none, or matches not in all."""
    if len(pattern) > LONGEST_PATTERN:
        raise ConfigError(f"study.room has {len(pattern)} characters; give a pattern of at most {LONGEST_PATTERN}")
    try:
        found = [re.search(pattern, name) for name in names]
    except re.error as error:
        raise ConfigError(f"study.room={pattern!r} is no regular expression ({error}); mend it") from error
    without = [name for name, match in zip(names, found, strict=True) if match is None]
    if without:
        raise ConfigError(
            f"study.room={pattern!r} matches nothing in {len(without)} of {len(names)} names of images, {without[0]} say; give"
            " what names the room in all of them"
        )
    return [match[0] for match in found if match is not None]


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
