"""Poses from files, and as text: TUM's format, KITTI's, or a CSV."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.geometry import poses, quaternion_xyzw
from omnilab.trajectory.tables import read_table


@dataclass(frozen=True)
class Trajectory:
    """N poses in their order, and when each was taken where that is known."""

    T_world_camera: Floats  # (N, 4, 4)
    stamps_ns: Ints | None  # (N,)
    turn: tuple[str, ...] = ()  # the columns that gave the rotation; (): there were none
    numbers: Floats | None = None  # (N,) in the column of headings, as written, where one gave the rotation


def read_trajectory(file: Path, lenient: bool = False, level: bool = False) -> Trajectory:
    """Poses of a CSV with a header, or of a file in TUM's format (`t tx ty tz qx qy qz qw`) or KITTI's (12 numbers).

    A CSV has x_m, y_m, z_m (or _cm, _mm) and, for the rotation, one of: r00 ... r22; qx, qy, qz, qw; rx_deg, ry_deg,
    rz_deg (or _rad) in the order of `geometry.rotation_xyz`; yaw_deg, yaw_rad or heading_deg; without any, the camera
    stands upright at heading 0. stamp_ns (_us, _ms, _s) is when.
    `lenient`: quaternions may have any length above 0. `level`: without z_m, poses are at height 0.
    DataError names what the file is, or line and column of what is missing or wrong.
    """
    table = read_table(file)
    T = poses(table.position_m(level), table.rotations(lenient))
    return Trajectory(T, table.stamps_ns(), table.turn, table.heading_numbers())


# ------------------------------------------------------------------------------------------------------------- writing
def tum_text(T: Floats, stamps_ns: Ints) -> str:
    """Poses (N, 4, 4) at times (N,) in TUM's format, `timestamp tx ty tz qx qy qz qw`; numbers read back exactly."""
    rows = np.column_stack([T[:, :3, 3], quaternion_xyzw(T)]).tolist()
    times = [f"{'-' * (t < 0)}{abs(t) // 10**9}.{abs(t) % 10**9:09d}" for t in stamps_ns.tolist()]
    return "".join(f"{time} {' '.join(map(repr, row))}\n" for time, row in zip(times, rows, strict=True))


def kitti_text(T: Floats) -> str:
    """Poses (N, 4, 4) in KITTI's format: the upper three rows of each, row by row."""
    return "".join(" ".join(map(repr, row)) + "\n" for row in T[:, :3].reshape(-1, 12).tolist())
