"""Poses between the poses of a trajectory."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.geometry import poses, quaternion_xyzw, rotation_of_quaternion

LINEAR = 1e-8  # sine of half a turn, below which a great circle is a straight line


def interpolate(T: Floats, stamps_ns: Ints, at_ns: Ints, tolerance_ns: int) -> tuple[Floats, Bools]:
    """Poses (M, 4, 4) at times (M,), and which of them are known (M,), from poses (N, 4, 4) at ascending times (N,).

    Positions run straight, rotations along the great circle of their quaternions (Shoemake, 1985). Known is what lies at a
    pose's own time, or between two of which neither is farther off than the tolerance; nothing is extrapolated.
    """
    after = np.searchsorted(stamps_ns, at_ns).clip(0, len(stamps_ns) - 1)  # the first that is not earlier
    before = np.where(stamps_ns[after] == at_ns, after, (after - 1).clip(0))
    since, until = at_ns - stamps_ns[before], stamps_ns[after] - at_ns
    known = (since >= 0) & (until >= 0) & (np.maximum(since, until) <= tolerance_ns)
    share = since / np.maximum(since + until, 1)
    share = np.where(known, share, 0.0)
    position_m = (1 - share)[:, None] * T[before, :3, 3] + share[:, None] * T[after, :3, 3]
    R = rotation_of_quaternion(slerp(quaternion_xyzw(T[before]), quaternion_xyzw(T[after]), share))
    found = poses(position_m, R)
    exact = share == 0
    found[exact] = T[before[exact]]  # to the last bit
    return found, known


def slerp(first_xyzw: Floats, second_xyzw: Floats, share: Floats) -> Floats:
    """Quaternions (M, 4) a share (M,) of the shorter way from unit quaternions (M, 4) to others."""
    cosine = (first_xyzw * second_xyzw).sum(axis=-1)
    second = np.where(cosine[:, None] < 0, -second_xyzw, second_xyzw)
    # the angle by its half chord: an arc cosine loses half the digits of small ones
    half = np.arctan2(np.linalg.norm(second - first_xyzw, axis=-1), np.linalg.norm(second + first_xyzw, axis=-1))
    sine = np.sin(2 * half)
    straight = sine < LINEAR
    scale = np.where(straight, 1.0, sine)
    one = np.where(straight, 1 - share, np.sin((1 - share) * 2 * half) / scale)
    other = np.where(straight, share, np.sin(share * 2 * half) / scale)
    return np.asarray(one[:, None] * first_xyzw + other[:, None] * second)
