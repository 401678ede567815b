"""Positions file of a recording: a CSV, one row per image, or a trajectory."""

from __future__ import annotations

from dataclasses import dataclass, replace

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.trajectory.tables import PoseTable


@dataclass(frozen=True)
class Positions:
    """Where N images were taken, in the order of the file."""

    images: list[str]  # (N,) paths below the folder
    position_m: Floats  # (N, 3) world
    R_world_robot: Floats  # (N, 3, 3) as the file says; of a robot on a plane, the heading alone
    cells: Ints | None  # (N, 2) column and row in a grid
    stamps_ns: Ints | None  # (N,)
    turn: tuple[str, ...] = ()  # the columns, or groups of a name, that gave the rotation; (): none
    numbers: Floats | None = None  # (N,) of the heading as written, where it gave the rotation

    def clockwise(self) -> Positions:
        """The same with headings that run clockwise; DataError unless yaw_deg or yaw_rad gave them."""
        if self.turn not in {("yaw_deg",), ("yaw_rad",)}:
            given = ", ".join(self.turn) or "nothing"
            raise DataError(
                f"headings=clockwise speaks of yaw_deg and yaw_rad, and {given} gives the rotations; leave it out"
            )
        return replace(self, R_world_robot=self.R_world_robot.swapaxes(1, 2))


def positions_in(table: PoseTable) -> Positions:
    """The rows of a table with a column `image`; its other columns are those of `omnilab.trajectory.columns`, without
    z_m at height 0. DataError names the line of a value that is missing, not finite or not a number.
    """
    images = table.images()
    position_m = table.position_m(level=True)
    R, turn = table.rotations(lenient=True), table.turn
    return Positions(images, position_m, R, table.cells(), table.stamps_ns(), turn, table.heading_numbers())
