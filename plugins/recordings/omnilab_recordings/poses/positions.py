"""Positions file of a recording: a plain CSV with a header row, one row per image."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.geometry import rotation_of_quaternion, rotation_xyz

N = TypeVar("N", int, float)

LARGEST_FILE = 256 * 2**20  # bytes
MOST_ROWS = 2_000_000
TOLERANCE = 1e-3  # of R times its transpose to the unit matrix: what four written digits leave
ROTATIONS: dict[tuple[str, ...], Callable[[Floats], Floats]] = {  # by the columns that give them, the most exact first
    tuple(f"r{i}{j}" for i in range(3) for j in range(3)): lambda r: r.reshape(-1, 3, 3),
    ("qx", "qy", "qz", "qw"): rotation_of_quaternion,
    ("rx_deg", "ry_deg", "rz_deg"): lambda angles: rotation_xyz(*np.deg2rad(angles).T),
    ("yaw_deg",): lambda yaw: rotation_xyz(0, 0, np.deg2rad(yaw[:, 0])),
}


@dataclass(frozen=True)
class Positions:
    """Where N images were taken, in the order of the file."""

    images: list[str]  # (N,) paths below the folder
    position_m: Floats  # (N, 3) world
    R_world_robot: Floats  # (N, 3, 3) as the file says; of a robot on a plane, the heading alone
    cells: Ints | None  # (N, 2) column and row in a grid
    stamps_ns: Ints | None  # (N,)


def read_positions(file: Path) -> Positions:
    """Read columns image, x_m, y_m and, where there, z_m, ix, iy, stamp_ns and a rotation; others are ignored.

    The rotation is given by the first of these that there are: r00 ... r22 (the matrix, row by row, robot to world),
    qx, qy, qz, qw, rx_deg, ry_deg, rz_deg (Rx Ry Rz; Berenguer, thesis, eq. 3.11), yaw_deg. DataError names the line of a value that is missing, not finite or not a number.
    """
    table = _PositionTable(file)
    if not table.rows:
        raise DataError(f"{file} names no image; give it a header and one row per image")
    return Positions(
        images=table.names("image"),
        position_m=np.stack([table.floats("x_m"), table.floats("y_m"), table.floats("z_m", optional=True)], -1),
        R_world_robot=_rotations(table),
        cells=np.stack([table.ints("ix"), table.ints("iy")], -1) if table.has("ix") or table.has("iy") else None,
        stamps_ns=table.ints("stamp_ns") if table.has("stamp_ns") else None,
    )


def _rotations(table: _PositionTable) -> Floats:
    for columns, rotations in ROTATIONS.items():
        if any(map(table.has, columns)):
            values = np.stack([table.floats(column) for column in columns], -1)
            with np.errstate(invalid="ignore"):  # a quaternion of zeros
                R = rotations(values)
                good = (np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)) < TOLERANCE).all((-1, -2)) & (np.linalg.det(R) > 0)
            if not good.all():
                line = table.lines[int(np.argmin(good))]
                raise table.error(line, f"has no rotation in {', '.join(columns)}", "write a proper rotation")
            return R
    return np.tile(np.eye(3), (len(table.rows), 1, 1))


class _PositionTable:
    """The cells of a CSV as text, with the line that each row ends on."""

    def __init__(self, file: Path) -> None:
        self.file = file
        if file.stat().st_size > LARGEST_FILE:
            raise DataError(f"{file} is larger than {LARGEST_FILE >> 20} MiB; split the recording into several folders")
        try:
            with file.open(newline="", encoding="utf-8-sig") as stream:
                self._fill(csv.reader(stream, strict=True))
        except (UnicodeDecodeError, csv.Error) as error:
            raise DataError(f"{file} is not a CSV in UTF-8 ({error}); save it as comma-separated text") from error

    def _fill(self, reader: Any) -> None:
        self.header = [name.strip() for name in next(reader, [])]
        if len(set(self.header)) < len(self.header):
            raise DataError(f"{self.file} has two columns of one name in its header {self.header}; remove one")
        self.lines, self.rows = [], []
        for row in filter(None, reader):
            if len(row) != len(self.header):
                raise self.error(
                    reader.line_num, f"has {len(row)} values for {len(self.header)} columns", "separate by commas"
                )
            self.lines.append(reader.line_num)
            self.rows.append(row)
            if len(self.rows) > MOST_ROWS:
                raise DataError(f"{self.file} has more than {MOST_ROWS} rows; split the recording into several folders")

    def error(self, line: int, problem: str, remedy: str) -> DataError:
        return DataError(f"line {line} of {self.file} {problem}; {remedy}")

    def has(self, column: str) -> bool:
        return column in self.header

    def names(self, column: str) -> list[str]:
        seen: dict[str, int] = {}
        for line, text in self._cells(column):
            name = Path(text).as_posix()
            if name in seen:
                raise self.error(line, f"names {name} again, after line {seen[name]}", "keep one row per image")
            seen[name] = line
        return list(seen)

    def floats(self, column: str, optional: bool = False) -> Floats:
        if optional and not self.has(column):
            return np.zeros(len(self.rows))
        return np.array(self._numbers(column, float, "a finite number"), np.float64)

    def ints(self, column: str) -> Ints:
        return np.array(self._numbers(column, int, "a whole number of at most 64 bits"), np.int64)

    def _numbers(self, column: str, parse: Callable[[str], N], kind: str) -> list[N]:
        values = []
        for line, text in self._cells(column):
            try:
                value = parse(text)
            except ValueError:
                value = None
            if value is None or not abs(value) < 2**63:  # NaN is not less
                raise self.error(line, f"has {column}={text!r}", f"write {kind}")
            values.append(value)
        return values

    def _cells(self, column: str) -> Iterator[tuple[int, str]]:
        if not self.has(column):
            raise DataError(
                f"{self.file} has no column {column}, only {', '.join(self.header) or 'an empty header'}; add it"
            )
        place = self.header.index(column)
        return ((line, row[place].strip()) for line, row in zip(self.lines, self.rows, strict=True))
