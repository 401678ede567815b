"""The corners of a checkerboard in a picture, by OpenCV's two finders, each corner refined within its own squares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.cameras.calibration.board import FEWEST, MOST, Board, front_side
from omnilab.cameras.calibration.grid import is_checkered

SEARCHED = 2**21  # pixels of a picture in which a board is searched; larger ones are reduced
WINDOW = 0.3  # half the side of what a corner is refined in, in distances to the nearest other corner
WINDOW_PX = (2, 10)  # the same in pixels, at least and at most: lines are straight in small windows

Finder = Callable[[Bytes, Board], Floats | None]


def find_corners(image: Bytes, board: Board) -> Floats | None:
    """Corners (rows x columns, 2) of a board in a grey image (H, W), row by row, as seen from its front; None without one."""
    for shown, scale, finder in _tries(image):
        found = finder(shown, board)
        if found is None:
            continue
        pixels = _refined(image, (found + 0.5) / scale - 0.5, board)
        if is_checkered(image, pixels, board):
            return front_side(pixels, board.rows, board.columns)
    return None


def _tries(image: Bytes) -> Iterator[tuple[Bytes, float, Finder]]:
    """Pictures in which the board is searched, their scales, and by which finder: what is quick first."""
    import cv2

    scale = min(1.0, float(np.sqrt(SEARCHED / image.size)))
    small = image if scale == 1 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    even = cv2.createCLAHE(clipLimit=4.0, tileGridSize=(4, 4)).apply(small)
    yield small, scale, _by_quads
    yield even, scale, _by_quads
    yield small, scale, _by_sectors
    large = cv2.resize(small, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    yield large, 2 * scale, _by_quads
    yield large, 2 * scale, _by_sectors


def _by_quads(image: Bytes, board: Board) -> Floats | None:
    import cv2

    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, pixels = cv2.findChessboardCorners(image, (board.columns, board.rows), flags=flags)
    return pixels.reshape(-1, 2).astype(float) if found else None


def _by_sectors(image: Bytes, board: Board) -> Floats | None:
    """Duda and Frese (2018)."""
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, pixels = cv2.findChessboardCornersSB(image, (board.columns, board.rows), flags=flags)
    return pixels.reshape(-1, 2).astype(float) if found else None


def _refined(image: Bytes, pixels: Floats, board: Board) -> Floats:
    """Each corner where the grey levels around it are steepest across the lines to it (Foerstner and Guelch, 1987)."""
    import cv2

    ends = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-3)
    half = np.clip(np.rint(WINDOW * nearest_px(pixels, board)).astype(int), *WINDOW_PX)
    return np.array([
        cv2.cornerSubPix(image, at.astype(np.float32).reshape(1, 1, 2), (side, side), (-1, -1), ends)[0, 0]
        for at, side in zip(pixels, half.tolist(), strict=True)
    ], float)  # fmt: skip


def nearest_px(pixels: Floats, board: Board) -> Floats:
    """The distance (rows x columns) of each corner to its nearest neighbour."""
    grid = pixels.reshape(board.rows, board.columns, 2)
    nearest = np.full(grid.shape[:2], np.inf)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(grid, axis=axis), axis=-1)
        for side in ((1, 0), (0, 1)):
            pad = [(0, 0), (0, 0)]
            pad[axis] = side
            nearest = np.fmin(nearest, np.pad(step, pad, constant_values=np.inf))
    return nearest.ravel()


def other_board(images: Sequence[Bytes], board: Board) -> Board | None:
    """A board of a few rows or columns more or less that is in one of the pictures, the largest; None without one."""
    for more in sorted(product(range(-3, 4), repeat=2), key=sum, reverse=True):
        rows, columns = board.rows + more[0], board.columns + more[1]
        if more == (0, 0) or not (min(rows, columns) >= FEWEST and max(rows, columns) <= MOST):
            continue
        other = Board(rows, columns, board.square_m)
        for image in images:
            shown, scale, finder = next(_tries(image))
            found = finder(shown, other)
            if found is not None and is_checkered(image, (found + 0.5) / scale - 0.5, other):
                return other
    return None
