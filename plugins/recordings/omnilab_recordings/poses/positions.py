"""Positions file of a recording: a CSV, one row per image, or a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omnilab.api import Floats, Ints
from omnilab.trajectory.tables import read_table


@dataclass(frozen=True)
class Positions:
    """Where N images were taken, in the order of the file."""

    images: list[str]  # (N,) paths below the folder
    position_m: Floats  # (N, 3) world
    R_world_robot: Floats  # (N, 3, 3) as the file says; of a robot on a plane, the heading alone
    cells: Ints | None  # (N, 2) column and row in a grid
    stamps_ns: Ints | None  # (N,)
    turn: tuple[str, ...] = ()  # the columns, or groups of a name, that gave the rotation; (): none


def read_positions(file: Path) -> Positions:
    """The rows of a CSV with a column `image`; its other columns are those of `omnilab.trajectory.columns`, without
    z_m at height 0. DataError names the line of a value that is missing, not finite or not a number.
    """
    table = read_table(file)
    images = table.images()
    position_m = table.position_m(level=True)
    return Positions(images, position_m, table.rotations(lenient=True), table.cells(), table.stamps_ns(), table.turn)
