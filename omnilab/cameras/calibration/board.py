"""The checkerboard, and its corners as pictures show them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.errors import ConfigError

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "inch": 0.0254}
FEWEST, MOST = 3, 64  # inner corners along a side
SMALLEST_M, LARGEST_M = 1e-3, 2.0  # side of a square


@dataclass(frozen=True)
class Board:
    """A checkerboard, told by its inner corners: where four squares meet."""

    rows: int
    columns: int
    square_m: float  # side of a square; lengths of the poses follow from it, the camera does not

    def __post_init__(self) -> None:
        for count in (self.rows, self.columns):
            if not FEWEST <= count <= MOST:
                raise ConfigError(
                    f"a board of {self.rows}x{self.columns} inner corners is none; give {FEWEST} to {MOST} a side, such"
                    " as --board 6x7"
                )
        if not SMALLEST_M <= self.square_m <= LARGEST_M:
            raise ConfigError(
                f"squares of {self.square_m:g} m are on no board; give the side of one with its unit, such as --square 30mm"
            )

    @classmethod
    def of_texts(cls, board: str, square: str) -> Self:
        """The board of "6x7" (inner corners) and "30mm"; ConfigError that says what is missing."""
        counts = re.fullmatch(r"(\d{1,4})\s*[xX×]\s*(\d{1,4})", board.strip())
        if counts is None:
            raise ConfigError(f"--board {board} is no board; give its inner corners, rows x columns, such as 6x7")
        side = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-zA-Z]*)", square.strip())
        if side is None or (side[2] and side[2] not in METRES):
            raise ConfigError(f"--square {square} is no length; give one such as 30mm, 3cm or 0.03m")
        if not side[2]:
            raise ConfigError(f"--square {square} has no unit; give {square}mm, {square}cm or {square}m")
        return cls(int(counts[1]), int(counts[2]), float(side[1]) * METRES[side[2]])

    @property
    def points(self) -> Floats:
        """Corners (rows x columns, 3) in the board's plane, x along the columns, y along the rows, in squares."""
        row, column = np.indices((self.rows, self.columns)).reshape(2, -1)
        return np.stack([column, row, np.zeros_like(row)], -1).astype(float)

    def __str__(self) -> str:
        return f"{self.rows}x{self.columns}"


@dataclass(frozen=True)
class Corners:
    """The corners of one board in pictures (B) of one size; NaN where a corner is not seen."""

    board: Board
    width: int
    height: int
    names: tuple[str, ...]  # of the pictures
    pixels: Floats  # (B, rows x columns, 2) = (u, v), row by row

    @property
    def seen(self) -> Bools:
        """Which corners (B, rows x columns) are."""
        return np.asarray(np.isfinite(self.pixels).all(-1))

    @property
    def spacing_px(self) -> Floats:
        """Medians (B) of the distance between neighbouring corners."""
        grid = self.pixels.reshape(-1, self.board.rows, self.board.columns, 2)
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).reshape(len(grid), -1) for axis in (1, 2)]
        return np.asarray(np.nanmedian(np.concatenate(steps, 1), 1))

    def at(self, which: Sequence[int] | Ints | Bools) -> Corners:
        """Those of some pictures."""
        rows = np.arange(len(self.names))[np.asarray(which)]
        return Corners(self.board, self.width, self.height, tuple(self.names[i] for i in rows), self.pixels[rows])

    def without(self, wrong: Bools) -> Corners:
        """Without some of the corners (B, rows x columns)."""
        pixels = np.where(wrong[..., None], np.nan, self.pixels)
        return Corners(self.board, self.width, self.height, self.names, pixels)


def front_side(pixels: Floats, rows: int, columns: int) -> Floats:
    """Corners (rows x columns, 2) in an order in which columns turn into rows clockwise in the picture, as seen from the front.

    A checkerboard looks the same with its columns counted from the other side, and finders return either.
    """
    grid = pixels.reshape(rows, columns, 2)
    along, across = np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1]
    turn = np.nansum(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])
    return (grid if turn > 0 else grid[:, ::-1]).reshape(-1, 2)
