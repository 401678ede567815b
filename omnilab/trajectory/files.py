"""Poses from a file, in TUM's format or as a CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.geometry import poses, quaternion_xyzw, rotation_of_quaternion, rotation_xyz

LARGEST_FILE = 256 * 2**20  # bytes
MOST_POSES = 2_000_000
TUM = ("t", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
POSITION = ("x_m", "y_m", "z_m")
MATRIX = tuple(f"r{i}{j}" for i in range(3) for j in range(3))
# the columns that may give a rotation, the most exact first: positions.csv of a data set has both a matrix and a heading
ROTATIONS: Mapping[tuple[str, ...], Callable[[Floats], Floats]] = {
    MATRIX: lambda values: values.reshape(-1, 3, 3),
    TUM[4:]: rotation_of_quaternion,
    ("rx_deg", "ry_deg", "rz_deg"): lambda values: rotation_xyz(*np.deg2rad(values).T),
    ("yaw_deg",): lambda values: rotation_xyz(0, 0, np.deg2rad(values[:, 0])),
}


@dataclass(frozen=True)
class Trajectory:
    """N poses in their order, and when each was taken where that is known."""

    T_world_camera: Floats  # (N, 4, 4)
    stamps_ns: Ints | None  # (N,)


class PoseLineError(DataError):
    """A line of a file that is no pose: its number, and its values as text."""

    def __init__(self, sentence: str, number: int, values: Sequence[str]) -> None:
        super().__init__(sentence)
        self.number, self.values = number, values


class NoPoseError(DataError):
    """A file without poses."""


def read_trajectory(file: Path, lenient: bool = False) -> Trajectory:
    """Poses of a CSV (`*.csv`) with a header, or else of a file in TUM's format: `t tx ty tz qx qy qz qw`.

    A CSV has x_m, y_m, z_m and, for the rotation, one of: r00 ... r22; qx, qy, qz, qw; rx_deg, ry_deg, rz_deg in the
    order of `geometry.rotation_xyz`; yaw_deg; without any, the camera stands upright at heading 0. stamp_ns is when.
    `lenient`: quaternions may have any length above 0, and comments any encoding.
    DataError names line and column of what is missing or wrong, PoseLineError where it is one line.
    """
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise DataError(f"{file} is larger than {LARGEST_FILE >> 20} MiB; split the path")
        with file.open(newline="", encoding="utf-8-sig", errors="replace" if lenient else "strict") as stream:
            table = _Table(file, _csv(file, stream) if file.suffix.lower() == ".csv" else _tum(stream))
    except OSError as error:
        raise DataError(
            f"the poses {file} cannot be read ({error.strerror}); give a file in TUM's format or a CSV"
        ) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{file} is no text of poses ({error}); write TUM's format or a CSV") from None
    position = table.floats(TUM[1:4] if "tx" in table.header else POSITION)
    return Trajectory(poses(position, _rotations(table, lenient)), table.stamps_ns())


Line = tuple[int, Sequence[str]]  # its number, and its values as text


def _csv(file: Path, stream: Iterator[str]) -> Iterator[Line]:
    """The header as line 0, and the rows."""
    reader = csv.reader(stream, strict=True)
    header = [name.strip() for name in next(reader, [])]
    if len(set(header)) < len(header):
        raise DataError(f"{file} has two columns of one name in its header {header}; remove one")
    yield 0, header
    yield from ((reader.line_num, row) for row in reader if row)


def _tum(stream: Iterator[str]) -> Iterator[Line]:
    """The names of TUM's columns as line 0, and the rows; comments start with #."""
    yield 0, TUM
    rows = ((number, line.partition("#")[0].split()) for number, line in enumerate(stream, 1))
    yield from ((number, row) for number, row in rows if row)


class _Table:
    """Rows of text, by the names of their columns."""

    def __init__(self, file: Path, lines: Iterator[Line]) -> None:
        self.file = file
        _, self.header = next(lines)
        self.lines: list[Line] = []
        for line in lines:
            if len(line[1]) != len(self.header):
                problem, remedy = f"has {len(line[1])} values", f"write {len(self.header)}: {' '.join(self.header)}"
                raise self.error(line, problem, remedy)
            self.lines.append(line)
            if len(self.lines) > MOST_POSES:
                raise DataError(f"{file} has more than {MOST_POSES} poses; split the path")
        if not self.lines:
            raise NoPoseError(f"{file} holds no pose; write one in each line")

    def error(self, line: Line, problem: str, remedy: str) -> PoseLineError:
        number, values = line
        return PoseLineError(f"line {number} of {self.file} {problem}; {remedy}", number, values)

    def texts(self, column: str) -> Iterator[tuple[Line, str]]:
        """Line and text of each value of a column; DataError for one that is no finite number."""
        if column not in self.header:
            raise DataError(f"{self.file} has no column {column}, only {', '.join(self.header) or 'none'}; add it")
        place = list(self.header).index(column)
        for line in self.lines:
            value = line[1][place]
            try:
                usable = math.isfinite(float(value))
            except ValueError:
                usable = False
            if not usable:
                raise self.error(line, f"has {column}={value.strip()!r} (column {place + 1})", "write a finite number")
            yield line, value

    def floats(self, columns: Sequence[str]) -> Floats:
        """Values (N, columns)."""
        return np.array([[float(text) for _, text in self.texts(column)] for column in columns]).T

    def stamps_ns(self) -> Ints | None:
        """Nanoseconds (N,), exact: seconds since 1970 need more digits than a float has."""
        name, unit = ("t", 10**9) if "t" in self.header else ("stamp_ns", 1)
        if name not in self.header:
            return None
        stamps = []
        for line, text in self.texts(name):
            if not abs(float(text)) * unit < 2**63:
                raise self.error(line, f"has {name}={text.strip()}", "write a time of at most 292 years")
            stamps.append(int((Decimal(text.strip()) * unit).to_integral_value()))
        return np.array(stamps, np.int64)


def _rotations(table: _Table, lenient: bool) -> Floats:
    """Rotations (N, 3, 3)."""
    for columns, rotation in ROTATIONS.items():
        absent = [name for name in columns if name not in table.header]
        if not absent:
            values = table.floats(columns)
            _check_rotations(table, columns, values, lenient)
            return rotation(values)
        if len(absent) < len(columns):
            raise DataError(
                f"{table.file} lacks {', '.join(absent)}; give all of {', '.join(columns)}, or none of them"
            )
    return np.tile(np.eye(3), (len(table.lines), 1, 1))


def _check_rotations(table: _Table, columns: Sequence[str], values: Floats, lenient: bool) -> None:
    """DataError for a quaternion whose length is off by 1 % (lenient: 0), or a matrix that is no rotation."""
    if columns == MATRIX:
        R = values.reshape(-1, 3, 3)
        wrong = (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) > 1e-6).any((1, 2)) | (np.linalg.det(R) < 0)
    elif columns == TUM[4:]:
        length = np.linalg.norm(values, axis=1)
        wrong = length == 0 if lenient else np.abs(length - 1) > 0.01
    else:
        return
    if wrong.any():
        row = int(wrong.argmax())
        kind = "no rotation matrix" if columns == MATRIX else "no unit quaternion"
        raise table.error(
            table.lines[row], f"has {columns[0]} to {columns[-1]} = {values[row].tolist()}, {kind}", "normalise it"
        )


# ------------------------------------------------------------------------------------------------------------- writing
def tum_text(T: Floats, stamps_ns: Ints) -> str:
    """Poses (N, 4, 4) at times (N,) in TUM's format, `timestamp tx ty tz qx qy qz qw`; numbers read back exactly."""
    rows = np.column_stack([T[:, :3, 3], quaternion_xyzw(T)]).tolist()
    times = [f"{'-' * (t < 0)}{abs(t) // 10**9}.{abs(t) % 10**9:09d}" for t in stamps_ns.tolist()]
    return "".join(f"{time} {' '.join(map(repr, row))}\n" for time, row in zip(times, rows, strict=True))


def kitti_text(T: Floats) -> str:
    """Poses (N, 4, 4) in KITTI's format: the upper three rows of each, row by row."""
    return "".join(" ".join(map(repr, row)) + "\n" for row in T[:, :3].reshape(-1, 12).tolist())
