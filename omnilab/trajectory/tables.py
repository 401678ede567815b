"""Pose tables as text: a CSV with a header, or rows in the formats of TUM (8 numbers) and KITTI (12 numbers)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from itertools import chain
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Floats, Ints
from omnilab.errors import DataError
from omnilab.file_kinds import content_of, has_longer_line, how_to_export, kind_of_file
from omnilab.trajectory.clocks import unit_of
from omnilab.trajectory.columns import LENGTHS, MATRIX, QUATERNION, ROTATIONS, STAMPS, TUM
from omnilab.trajectory.lookalikes import NUMBER, image_column, misnamed

LARGEST_FILE = 256 * 2**20  # bytes
LONGEST_LINE = 2**16  # bytes
MOST_POSES = 2_000_000
ROUNDING = 1e-7  # of the same, as numbers of full length leave it
TOLERANCE = 1e-3  # of R times its transpose to the unit matrix: what four written digits leave
FORMATS = "a CSV with a header, or TUM's or KITTI's format"
TUM_ROW = ("t", "tx", "ty", "tz", *QUATERNION)
KITTI_ROW = tuple(name for i in range(3) for name in (*MATRIX[3 * i : 3 * i + 3], f"{'xyz'[i]}_m"))

Line = tuple[int, Sequence[str]]  # its number, and its values as text


class PoseTable:
    """Rows of text, by the names of their columns (`omnilab.trajectory.columns`)."""

    def __init__(self, file: Path, lines: Iterator[Line]) -> None:
        self.file = file
        _, header = next(lines)
        self._written = header
        self.header = [TUM.get(name, name) for name in header] if "tx" in header else list(header)
        self.lines: list[Line] = []
        for number, row in lines:
            if len(row) != len(header):
                raise self._error(number, *_of_another_length(row, header))
            self.lines.append((number, row))
            if len(self.lines) > MOST_POSES:
                raise DataError(f"{file} has more than {MOST_POSES} rows; split it")
        if not self.lines:
            raise DataError(f"{file} holds no pose; write one in each line, in {FORMATS}")
        if found := misnamed(self.header, self.lines[0][1]):
            raise DataError(f"{file} has a column {found[0]!r}, which is not read; {found[1]}, or remove it")

    @property
    def is_trajectory(self) -> bool:
        """Whether it has the columns of TUM's or KITTI's format, and no others."""
        return tuple(self._written) in {TUM_ROW, KITTI_ROW}

    def has(self, column: str) -> bool:
        """Whether there is a column of that name."""
        return column in self.header

    def images(self) -> list[str]:
        """Paths (N,) in the column `image`, all different."""
        seen: dict[str, int] = {}
        for number, text in self._texts("image"):
            if not text:
                raise self._error(number, "names no image", "write its path below the folder, or remove the row")
            name = PurePath(text).as_posix()
            if name in seen:
                raise self._error(number, f"names {name} again, after line {seen[name]}", "keep one row per image")
            seen[name] = number
        return list(seen)

    def position_m(self, level: bool = False) -> Floats:
        """Positions (N, 3). `level`: without a column for z, they are at height 0."""
        return np.stack([self._along_m(axis, level and axis == "z") for axis in "xyz"], -1)

    def _along_m(self, axis: str, optional: bool) -> Floats:
        for name, (of, metres) in LENGTHS.items():
            if of == axis and self.has(name):
                values = self.floats([name])[:, 0]
                return values if metres == 1 else values * metres
        return np.zeros(len(self.lines)) if optional else self.floats([f"{axis}_m"])[:, 0]

    @property
    def turn(self) -> tuple[str, ...]:
        """The columns that give the rotation; () if there are none, and DataError if some of them are missing."""
        for columns in ROTATIONS:
            absent = [name for name in columns if not self.has(name)]
            if not absent:
                return columns
            if len(absent) < len(columns):
                hint = " (they are counted from 0)" if columns == MATRIX and self.has("r33") else ""
                raise DataError(
                    f"{self.file} lacks {', '.join(absent)}; give all of {', '.join(columns)}{hint}, or none of them"
                )
        return ()

    def heading_numbers(self) -> Floats | None:
        """The numbers (N,) of the column that gives the heading, as written; None where no single column does."""
        return self.floats(self.turn)[:, 0] if len(self.turn) == 1 else None

    def rotations(self, lenient: bool = False) -> Floats:
        """Rotations (N, 3, 3). `lenient`: quaternions may have any length above 0, not only 1 to a hundredth."""
        if not (columns := self.turn):
            return np.tile(np.eye(3), (len(self.lines), 1, 1))
        values = self.floats(columns)
        if columns == QUATERNION:
            length = np.linalg.norm(values, axis=1)
            self._check(columns, values, length == 0 if lenient else np.abs(length - 1) > 0.01, "no unit quaternion")
        R = ROTATIONS[columns](values)
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
        self._check(columns, values, (off > TOLERANCE) | (np.linalg.det(R) < 0), "no rotation matrix")
        if (rounded := off > ROUNDING).any():
            U, _, Vt = np.linalg.svd(R[rounded])
            R[rounded] = U @ Vt  # the nearest rotations
        return R

    def _check(self, columns: Sequence[str], values: Floats, wrong: Bools, what: str) -> None:
        if wrong.any():
            row = int(wrong.argmax())
            problem = f"has {columns[0]} to {columns[-1]} = {values[row].tolist()}, {what}"
            raise self._error(self.lines[row][0], problem, "write a proper rotation")

    def cells(self) -> Ints | None:
        """Column and row (N, 2) in a grid, of ix and iy; None without these."""
        if not (self.has("ix") or self.has("iy")):
            return None
        kind = "a whole number of at most 64 bits"
        return np.stack([self._numbers(name, int, kind) for name in ("ix", "iy")], -1).astype(np.int64)

    def stamps_ns(self) -> Ints | None:
        """Nanoseconds (N,), exact: seconds since 1970 need more digits than a float has. None without a column for it."""
        name = next(filter(self.has, STAMPS), None)
        if name is None:
            return None

        def parse(text: str) -> int:
            value = Decimal(text) if _finite(text) else Decimal("nan")
            if name != "stamp_s" and int(value.as_tuple().exponent) > 0:
                raise ValueError  # 1.6E+18: a spreadsheet has cut off the digits
            return int((value * STAMPS[name]).to_integral_value())

        unit = "time in seconds" if name == "stamp_s" else f"whole number of {name.removeprefix('stamp_')}"
        return self._numbers(name, parse, f"a {unit}, all its digits, of at most 292 years").astype(np.int64)

    def floats(self, columns: Sequence[str]) -> Floats:
        """Values (N, columns); DataError for one that is no finite number."""
        return np.stack([self._numbers(column, _finite_number, "a finite number") for column in columns], -1)

    def _numbers(self, column: str, parse: Callable[[str], float], kind: str) -> npt.NDArray[Any]:
        values = []
        for number, text in self._texts(column):
            try:
                value = parse(text)
            except (ValueError, ArithmeticError):
                value = math.nan  # of which no comparison holds
            if not (abs(value) < 2**63):
                hint = _hint(column, text, value)
                place = self.header.index(column)
                problem = f"has {self._written[place]}={_short(text)!r} (column {place + 1})"
                raise self._error(number, problem, f"write {kind}{hint}")
            values.append(value)
        return np.array(values)

    def _texts(self, column: str) -> Iterator[tuple[int, str]]:
        """Number of the line and text of each value of a column."""
        if not self.has(column):
            other = image_column(self.header) if column == "image" else None
            hint = f"name {other!r} so, or add it" if other else "add it"
            names = ", ".join(self._written) or "an empty header"
            raise DataError(f"{self.file} has no column {column}, only {_short(names, 200)}; {hint}")
        place = self.header.index(column)
        return ((number, row[place].strip()) for number, row in self.lines)

    def _error(self, number: int, problem: str, remedy: str) -> DataError:
        return DataError(f"line {number} of {self.file} {problem}; {remedy}")


def _finite(text: str) -> bool:
    return "_" not in text and math.isfinite(float(text))  # Python reads 1_000, too


def _finite_number(text: str) -> float:
    return float(text) if _finite(text) else math.nan


def _hint(column: str, text: str, value: object) -> str:
    """What a value that cannot be used may have been meant to be."""
    if re.fullmatch(r"[-+]?\d+,\d+", text):
        return f" with a point, {text.replace(',', '.')}"
    if column == "stamp_s" and NUMBER.fullmatch(text) and (unit := unit_of(float(text))):
        return f" (this looks like {unit})"
    return " below 9e18" if isinstance(value, float) and math.isfinite(value) else ""


def _short(text: str, most: int = 60) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _of_another_length(row: Sequence[str], header: Sequence[str]) -> tuple[str, str]:
    """The problem with a row of another length than the header's, and its remedy."""
    comma = len(row) > len(header) and all(map(NUMBER.fullmatch, (value.strip() for value in row[-2:])))
    decimals = ", with points in numbers: 1.5" if comma else ""
    return f"has {len(row)} values for {len(header)} columns", f"write {_short(' '.join(header), 200)}{decimals}"


# ------------------------------------------------------------------------------------------------------------- reading
def read_table(file: Path) -> PoseTable:
    """The table in a file; DataError, naming what the file is, or the line and the column of what is wrong with it.

    Rows without a value (Excel's rows of commas) count for nothing. In TUM's and KITTI's formats comments start with #,
    and columns are named t, tx, ty, tz, qx, qy, qz, qw, or r00, r01, r02, x_m, r10 and so on.
    """
    text = _text(file)
    first = next((row for _, row in _rows(text)), [])
    spaced = bool(first) and all(map(NUMBER.fullmatch, first)) and len(first) > 1
    if spaced or (file.suffix.lower() != ".csv" and not any("," in word for word in first)):
        names = KITTI_ROW if len(first) == len(KITTI_ROW) else TUM_ROW
        return PoseTable(file, chain([(0, names)], _rows(text)))
    return PoseTable(file, _csv(file, text))


def _text(file: Path) -> str:
    """The content of a text file; DataError for any other, with what it is."""
    try:
        kind = kind_of_file(file)
        if kind is not None:
            remedy = how_to_export(file, kind) or f"give {FORMATS}"
            raise DataError(f"{file} is {kind}, and no text of poses; {remedy}")
        data = content_of(file, LARGEST_FILE)
        if has_longer_line(data, LONGEST_LINE):
            raise DataError(f"{file} has a line of more than {LONGEST_LINE} bytes; write a pose a line")
    except OSError as error:
        raise DataError(f"the poses {file} cannot be read ({error.strerror}); give {FORMATS}") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if all(line.partition(b"#")[0].isascii() for line in data.splitlines()):  # comments may have any encoding
            return data.decode("utf-8-sig", "replace")
        line = data.count(b"\n", 0, error.start) + 1
        raise DataError(f"line {line} of {file} is no text in UTF-8; save the file as UTF-8") from None


def _csv(file: Path, text: str) -> Iterator[Line]:
    """The header as line 0, and the rows that hold a value."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [name.strip() for name in next(reader, [])]
        _check_header(file, header)
        yield 0, header
        for row in reader:
            if any(map(str.strip, row)):
                while len(row) > len(header) and not row[-1].strip():
                    row.pop()
                yield reader.line_num, row
    except csv.Error:
        raise DataError(
            f"line {reader.line_num} of {file} has a quotation mark that does not close, or no text; mend or remove it"
        ) from None


def _check_header(file: Path, header: Sequence[str]) -> None:
    for separator, name in (";", "semicolons"), ("\t", "tabs"), ("|", "bars"):
        if len(header) < 3 and separator in "".join(header):
            raise DataError(f"{file} separates its columns by {name}; use commas, and points in numbers: 1.5, not 1,5")
    if len(header) > 1 and all(map(NUMBER.fullmatch, header)):
        raise DataError(f"line 1 of {file} holds numbers; write a header first: image,x_m,y_m,yaw_deg say")
    named = [name for name in header if name]
    if len(set(named)) < len(named):
        raise DataError(f"{file} has two columns of one name in its header {header}; remove one")


def _rows(text: str) -> Iterator[Line]:
    """Rows of values with spaces between them; comments start with #."""
    rows = ((number, line.partition("#")[0].split()) for number, line in enumerate(io.StringIO(text, None), 1))
    return ((number, row) for number, row in rows if row)
