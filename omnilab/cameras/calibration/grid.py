"""Whether corners are those of a checkerboard, and whether the board goes on beyond them."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.cameras.calibration.board import MOST, Board

BESIDE = 0.35  # where squares are looked at, in squares from a corner along either side
CLEAR = 0.3  # least contrast of a corner, in parts of the board's
MOST_CLEAR = 0.8  # share of a row's corners that must be clear for the row to be one


def is_checkered(image: Bytes, pixels: Floats, board: Board) -> bool:
    """Whether the squares between corners (rows x columns, 2) alternate between dark and bright."""
    grid = pixels.reshape(board.rows, board.columns, 2)
    contrast = _contrast(image, grid)
    middle = np.median(contrast)
    return bool(middle != 0 and (contrast / middle > CLEAR).all())


def whole_size(image: Bytes, pixels: Floats, board: Board) -> tuple[int, int]:
    """Rows and columns of inner corners of the board, which may go on beyond the corners found (rows x columns, 2)."""
    grid = pixels.reshape(board.rows, board.columns, 2)
    for _ in range(4):  # each side
        while len(grid) < MOST and _ends_in_corners(image, longer := _longer(grid)):
            grid = longer
        grid = np.rot90(grid)
    return grid.shape[0], grid.shape[1]


def _longer(grid: Floats) -> Floats:
    """With one more row at the end, as the last three go on."""
    return np.concatenate([grid, (3 * grid[-1] - 3 * grid[-2] + grid[-3])[None]])


def _ends_in_corners(image: Bytes, grid: Floats) -> bool:
    """Whether the last row is of corners, too."""
    contrast = _contrast(image, grid)
    return bool(np.mean(contrast[-1] / (np.median(contrast[:-1]) or np.inf) > CLEAR) >= MOST_CLEAR)


def _contrast(image: Bytes, grid: Floats) -> Floats:
    """Bright less dark (rows, columns) of the squares around each corner, its sign that of one colouring for all.

    Near 0 where the squares do not alternate: at the board's edge one of four is dark.
    """
    import cv2

    right, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    quadrants = []
    for across, along in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        at = (grid + BESIDE * (across * right + along * down)).astype(np.float32)
        quadrants.append(cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    a, b, c, d = np.array(quadrants, float)
    alternating = (a + c - b - d) / 2
    uneven = (np.abs(a - c) + np.abs(b - d)) / 2
    row, column = np.indices(grid.shape[:2])
    size = np.maximum(np.abs(alternating) - uneven, 0)
    return np.asarray(size * np.sign(alternating) * (-1.0) ** (row + column))
