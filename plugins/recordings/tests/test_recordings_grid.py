"""The grid is found in measured positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import GridPoses, RecordedPoses
from omnilab.errors import DataError
from omnilab_recordings import Folder
from omnilab_recordings.poses.grid import find_grid
from omnilab_recordings.poses.positions import Positions


def positions(xy_m, cells=None):
    n = len(xy_m)
    xyz = np.column_stack([xy_m, np.zeros(n)])
    return Positions([f"{i}.png" for i in range(n)], xyz, np.tile(np.eye(3), (n, 1, 1)), cells, None)


@settings(deadline=None)
@given(
    columns=st.integers(1, 12), rows=st.integers(1, 12), step=st.floats(0.05, 3), jitter=st.floats(0, 0.004),
    origin=st.floats(-50, 50), seed=st.integers(0, 100),
)  # fmt: skip
def test_columns_and_rows_in_measured_positions(columns, rows, step, jitter, origin, seed):
    rng = np.random.default_rng(seed)
    cells = np.stack(np.divmod(rng.permutation(columns * rows), rows), -1)
    xy_m = origin + step * cells + rng.uniform(-jitter, jitter, cells.shape)
    grid = find_grid(positions(xy_m))
    assert np.array_equal(grid.cells, cells)
    expected = np.where([columns > 1, rows > 1], step, 0)
    assert np.allclose(grid.spacing_m, expected, atol=2 * jitter + 1e-9)


def test_a_missing_column_leaves_a_gap():
    x = np.array([0, 0.3, 0.6, 1.2, 1.5])
    grid = find_grid(positions(np.column_stack([x, 0 * x])))
    assert grid.cells[:, 0].tolist() == [0, 1, 2, 4, 5]


def test_scattered_positions_and_a_fine_line_are_no_grid():
    rng = np.random.default_rng(3)
    assert find_grid(positions(rng.uniform(0, 5, (30, 2)))) is None
    assert find_grid(positions(np.column_stack([np.linspace(0, 1, 200), np.zeros(200)]))) is None


@pytest.mark.parametrize("step_m", [0.0, 0.00001])
def test_images_at_one_position_have_nothing_beside_them_and_are_said_to_be_at_one(write_grid, step_m):
    """Also degrees of longitude and latitude, or kilometres, taken as metres."""
    sensor = Folder(str(write_grid(3, 2, step_m)))
    with pytest.raises(
        DataError, match="6 images at one and the same position, and none besides those on a grid of each 2"
    ) as e:
        sensor.plan(RecordedPoses(without=GridPoses(every=2)))
    assert "mend the positions, which are in metres" in str(e.value)


def test_a_grid_beyond_the_images_is_said_in_words(write_grid):
    with pytest.raises(
        DataError, match=r"3 × 2 grid at 0.5 m, and none on a grid of every row and column at a height of 9.0 m"
    ):
        Folder(str(write_grid(3, 2))).plan(GridPoses(height_m=9.0))
