"""Regular grid of recorded positions, and the selection by a grid layout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, GridPoses, Ints
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.poses.positions import Positions

TOLERANCE_M = 0.01  # positions this close to a line of the grid are on it


@dataclass(frozen=True)
class PositionGrid:
    """Column and row of N positions, and what lies between neighbours."""

    cells: Ints  # (N, 2)
    spacing_m: Floats  # (2,) between columns and between rows; 0 where there is only one

    def __str__(self) -> str:
        columns, rows = (len(np.unique(line)) for line in self.cells.T)
        return f"{columns} × {rows} grid at {_metres(self.spacing_m)}"


def find_grid(positions: Positions) -> PositionGrid | None:
    """The grid of the columns ix and iy or, without these, of evenly spaced x and y; None if there is none."""
    cells = _even_cells(positions.position_m[:, :2]) if positions.cells is None else positions.cells
    return None if cells is None else PositionGrid(cells, _spacing(cells, positions.position_m[:, :2]))


def _even_cells(xy_m: Floats) -> Ints | None:
    columns, rows = _even_lines(xy_m[:, 0]), _even_lines(xy_m[:, 1])
    return None if columns is None or rows is None else np.stack([columns, rows], -1)


def _even_lines(values_m: Floats) -> Ints | None:
    """On which of evenly spaced lines each value lies (N,), counted from the lowest; None if they are not even."""
    ordered = np.sort(values_m)
    lines = [group.mean() for group in np.split(ordered, np.flatnonzero(np.diff(ordered) > TOLERANCE_M) + 1)]
    spacing = np.median(np.diff(lines)) if len(lines) > 1 else 1.0
    index = np.rint((values_m - lines[0]) / spacing).astype(np.int64)
    even = np.polynomial.Polynomial.fit(index, values_m, 1 if len(lines) > 1 else 0)
    return index if np.abs(values_m - even(index)).max() <= TOLERANCE_M else None


def _spacing(cells: Ints, xy_m: Floats) -> Floats:
    """Length of one step along columns and along rows (2,), in whichever direction of the plane they run."""
    steps_m = np.linalg.lstsq(cells - cells.mean(0), xy_m - xy_m.mean(0), rcond=None)[0]
    return np.where(np.ptp(cells, axis=0) > 0, np.linalg.norm(steps_m, axis=1), 0.0)


def on_grid(layout: GridPoses, grid: PositionGrid, position_m: Floats) -> Bools:
    """Which of the positions (N, 3) a grid layout takes."""
    taken: Bools = (grid.cells % _every(layout, grid) == 0).all(-1)
    if layout.extent_m is not None:
        taken &= (np.abs(position_m[:, :2]) <= np.asarray(layout.extent_m) / 2 + 1e-9).all(-1)
    if layout.height_m is not None:
        taken &= np.abs(position_m[:, 2] - layout.height_m) <= TOLERANCE_M
    return taken


def _every(layout: GridPoses, grid: PositionGrid) -> Ints:
    """Every how many columns and rows (2,) the layout takes one."""
    if layout.step_m is not None and layout.every is not None:
        raise ConfigError(
            f"a grid of step_m={layout.step_m} and every={layout.every} is requested; give one of the two"
        )
    if layout.step_m is not None:
        return _whole_steps(layout.step_m, grid)
    every = 1 if layout.every is None else layout.every
    if every < 1:
        raise ConfigError(f"every={every} is no count of rows and columns; give 1 or more")
    return np.array([every, every])


def _whole_steps(step_m: float, grid: PositionGrid) -> Ints:
    spacing = np.where(grid.spacing_m > 0, grid.spacing_m, step_m)  # of one line only, any step takes it
    every = np.rint(step_m / spacing)
    if (every < 1).any() or (np.abs(step_m - every * spacing) > TOLERANCE_M).any():
        multiples = ", ".join(_metres(n * grid.spacing_m) for n in (1, 2, 3))
        raise DataError(
            f"step_m={step_m} is no whole multiple of the {_metres(grid.spacing_m)} between recorded positions;"
            f" give {multiples}, and so on"
        )
    return every.astype(np.int64)


def _metres(lengths_m: Floats) -> str:
    """1.0 m, or 0.3 × 0.5 m where columns and rows differ."""
    known = [round(float(length), 3) for length in lengths_m if length > 0] or [0.0]
    return " × ".join(str(length) for length in sorted(set(known), key=known.index)) + " m"
