"""Columns of pose tables, and groups in the names of images: one vocabulary."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from omnilab.api import Floats
from omnilab.geometry import rotation_of_quaternion, rotation_xyz

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
# a column of a coordinate: its axis, and what its unit is in metres; of several of one axis, the first counts
LENGTHS = {
    f"{word}_{unit}": ("z" if word == "height" else word, metres)
    for unit, metres in UNITS_M.items()
    for word in ("x", "y", "z", "height")
}
HEADINGS: Mapping[str, Callable[[Floats], Floats]] = {  # to radians, counter-clockwise from the world's +x
    "yaw_deg": np.deg2rad,
    "yaw_rad": np.asarray,
    "heading_deg": lambda compass: np.deg2rad(90 - compass),  # clockwise from north, +y
}
STAMPS = {"stamp_ns": 1, "stamp_us": 10**3, "stamp_ms": 10**6, "stamp_s": 10**9}  # in nanoseconds
POSITION = ("x_m", "y_m", "z_m")
MATRIX = tuple(f"r{i}{j}" for i in range(3) for j in range(3))
QUATERNION = ("qx", "qy", "qz", "qw")


def _upright(to_rad: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    return lambda values: rotation_xyz(0, 0, to_rad(values[:, 0]))


# the columns that may give a rotation, the most exact first: positions.csv of a data set has both a matrix and a heading
ROTATIONS: Mapping[tuple[str, ...], Callable[[Floats], Floats]] = {
    MATRIX: lambda values: values.reshape(-1, 3, 3),
    QUATERNION: rotation_of_quaternion,
    ("rx_deg", "ry_deg", "rz_deg"): lambda values: rotation_xyz(*np.deg2rad(values).T),
    ("rx_rad", "ry_rad", "rz_rad"): lambda values: rotation_xyz(*values.T),
    **{(name,): _upright(to_rad) for name, to_rad in HEADINGS.items()},
}
TUM = {"t": "stamp_s", "tx": "x_m", "ty": "y_m", "tz": "z_m"}  # TUM's names, where a table has tx: ours
COLUMNS = ("image", *LENGTHS, *(name for columns in ROTATIONS for name in columns), "ix", "iy", *STAMPS)
