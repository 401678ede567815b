"""Corners as a table, so that any detector can be used: a CSV with the columns image, row, column, u, v."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np

from omnilab.api import Floats
from omnilab.atomic_files import write_whole
from omnilab.cameras.calibration.board import Board, Corners, front_side
from omnilab.errors import DataError
from omnilab.file_kinds import content_of

COLUMNS = ("image", "row", "column", "u", "v")
LARGEST_FILE = 64 * 2**20  # bytes
LEAST_SEEN = 0.5  # of a board's corners


def write_corners(file: Path, corners: Corners) -> None:
    """Write the corners that are seen, pixels counted from the middle of the first."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for name, pixels in zip(corners.names, corners.pixels, strict=True):
        for i in np.flatnonzero(np.isfinite(pixels).all(-1)):
            table.writerow([name, *divmod(int(i), corners.board.columns), *map(repr, pixels[i].tolist())])
    write_whole(file, lambda out: out.write(text.getvalue().encode()))


def read_corners(file: Path, board: Board, width: int, height: int) -> Corners:
    """The corners in a file, for pictures of a size; DataError names the line that is wrong."""
    try:
        text = content_of(file, LARGEST_FILE).decode("utf-8-sig")
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror}); give a CSV of {', '.join(COLUMNS)}") from None
    except UnicodeDecodeError:
        raise DataError(f"{file} is no text in UTF-8; give a CSV of {', '.join(COLUMNS)}") from None
    table = csv.DictReader(io.StringIO(text))
    if lacking := [name for name in COLUMNS if name not in (table.fieldnames or ())]:
        raise DataError(f"{file} has no column {', '.join(lacking)}; its first line should be {','.join(COLUMNS)}")
    boards: dict[str, Floats] = {}
    try:
        for line, row in enumerate(table, 2):
            _add(boards, row, f"{file}, line {line}", board, (width, height))
    except csv.Error as error:
        raise DataError(f"{file} is no CSV ({error}); write its lines as {','.join(COLUMNS)}") from None
    for name, pixels in boards.items():
        seen = int(np.isfinite(pixels).all(-1).sum())
        if seen < LEAST_SEEN * len(pixels):
            raise DataError(f"{file} has {seen} of the {len(pixels)} corners of {name}; give half of them or more")
    pixels = np.array([front_side(p, board.rows, board.columns) for p in boards.values()])
    return Corners(board, width, height, tuple(boards), pixels.reshape(-1, board.rows * board.columns, 2))


def _add(
    boards: dict[str, Floats], row: dict[str, str | None], where: str, board: Board, size: tuple[int, int]
) -> None:
    """Put the corner of a line into its board."""
    i, j = (_whole(row[name], where, name) for name in ("row", "column"))
    u, v = (_number(row[name], where, name) for name in ("u", "v"))
    if not (0 <= i < board.rows and 0 <= j < board.columns):
        raise DataError(
            f"{where}: row {i}, column {j} is not on a board of {board} inner corners; count from 0, rows first in --board"
        )
    if not (-0.5 <= u <= size[0] - 0.5 and -0.5 <= v <= size[1] - 0.5):
        raise DataError(
            f"{where}: the corner at ({u:g}, {v:g}) lies outside pictures of {size[0]} x {size[1]} pixels; u counts to the"
            " right, v down, in the pictures as they are"
        )
    pixels = boards.setdefault(str(row["image"]), np.full((board.rows * board.columns, 2), np.nan))
    at = i * board.columns + j
    if np.isfinite(pixels[at]).any():
        raise DataError(f"{where}: row {i}, column {j} of {row['image']} was there before; give each corner once")
    pixels[at] = u, v


def _whole(text: str | None, where: str, name: str) -> int:
    number = _number(text, where, name)
    if not number.is_integer():
        raise DataError(f"{where}: {name} is {text!s:.40}; write a whole number, counted from 0")
    return int(number)


def _number(text: str | None, where: str, name: str) -> float:
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise DataError(
            f"{where}: {name} is {text!s:.40}; write a finite number, and leave out corners that are not seen"
        )
    return number
