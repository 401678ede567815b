"""Checkerboards as a camera with one viewpoint sees them, so that finders and fits can be held against the truth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats
from omnilab.cameras.calibration.board import Board
from omnilab.cameras.lenses import AxialCamera
from omnilab.geometry import rotation_xyz

BLACK, WHITE, AROUND = (
    25.0,
    230.0,
    120.0,
)  # grey levels of squares, of the margin one square wide, and of what is around


def board_poses(
    board: Board,
    directions_deg: npt.ArrayLike,
    distances: npt.ArrayLike,
    tilts_deg: npt.ArrayLike,
    turns_deg: npt.ArrayLike,
) -> tuple[Floats, Floats]:
    """Poses R (B, 3, 3), t (B, 3) in squares of boards whose middle lies in a direction: angle to the axis, azimuth (B, 2).

    A board at a distance (B), in squares, faces the camera, but for tilts (B, 2) about the lines through its middle and a
    turn (B) in its plane.
    """
    angle, azimuth = np.deg2rad(directions_deg).T
    x, y = np.deg2rad(tilts_deg).T
    facing = rotation_xyz(0, 0, azimuth) @ rotation_xyz(0, angle, 0)
    R = facing @ rotation_xyz(x, y, 0) @ rotation_xyz(0, 0, np.deg2rad(turns_deg))
    return R, facing[..., 2] * np.asarray(distances)[:, None] - R @ board.points.mean(0)


def shown_corners(camera: AxialCamera, board: Board, R: Floats, t: Floats) -> Floats:
    """Where the corners (B, rows x columns, 2) of boards at poses appear."""
    return camera.image_points(board.points @ np.swapaxes(R, 1, 2) + t[:, None])


def render_board(camera: AxialCamera, board: Board, R: Floats, t: Floats, samples: int = 4) -> Bytes:
    """A picture (H, W) of a board at a pose; each pixel is the mean of samples x samples rays."""
    image = np.full((camera.height, camera.width), AROUND)
    rim = Board(board.rows + 4, board.columns + 4, board.square_m).points - [2, 2, 0]
    shown = camera.image_points(rim @ R.T + t)
    size = [camera.width, camera.height]
    if np.isfinite(shown).all():  # beyond it there is nothing but what is around
        (left, top), (right, bottom) = np.clip([shown.min(0) - 2, shown.max(0) + 3], 0, size).astype(int)
    else:
        (left, top), (right, bottom) = (0, 0), size
    v, u = np.mgrid[top:bottom, left:right]
    total = np.zeros(u.shape)
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for du in offsets:
        for dv in offsets:
            total += _brightness(camera.rays(np.stack([u + du, v + dv], -1)), board, R, t)
    image[top:bottom, left:right] = total / samples**2
    return np.asarray(np.rint(image), np.uint8)


def _brightness(rays: Floats, board: Board, R: Floats, t: Floats) -> Floats:
    with np.errstate(all="ignore"):  # rays along the plane, and none where the camera shows nothing
        depth = (R[:, 2] @ t) / (rays @ R[:, 2])
        x, y, _ = np.moveaxis((rays * depth[..., None] - t) @ R, -1, 0)
        x, y = (np.where(depth > 0, at, np.nan) for at in (x, y))
        squares = (x > -1) & (x < board.columns) & (y > -1) & (y < board.rows)
        margin = (x > -2) & (x < board.columns + 1) & (y > -2) & (y < board.rows + 1)
        dark = (np.floor(x) + np.floor(y)) % 2 == 0
    return np.where(squares & dark, BLACK, np.where(margin, WHITE, AROUND))
