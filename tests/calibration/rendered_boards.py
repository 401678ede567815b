"""Boards all over the picture, their corners known, and how far two cameras are apart."""

from __future__ import annotations

import numpy as np

from omnilab.cameras.calibration import Corners
from omnilab.cameras.calibration.models import sample_rays
from omnilab.cameras.calibration.rendering import board_poses, shown_corners


def exact(camera, board, R, t):
    """`Corners` without error."""
    names = tuple(f"board-{i}.png" for i in range(len(R)))
    return Corners(board, camera.width, camera.height, names, shown_corners(camera, board, R, t))


def many_poses(board, count=10):
    """Poses of boards that differ in place, distance, tilt and turn, out to 65 degrees from the axis and more."""
    i = np.arange(count)
    directions = np.column_stack([np.array([8, 22, 36, 48, 55])[i % 5], i * 222.5])
    tilts = np.column_stack([25.0 * (-1.0) ** i, 15.0 * (i % 3 - 1)])
    return board_poses(board, directions, 6 + 2 * (i % 3), tilts, 47.0 * i)


def apart_px(camera, truth, largest_deg):
    """How far (n) two cameras show the same rays apart, but for the rotation between their frames that is the best."""
    rays = sample_rays(np.deg2rad(largest_deg))
    seen = camera.rays(truth.image_points(rays))
    U, _, Vt = np.linalg.svd(seen.T @ rays)
    return np.linalg.norm(camera.image_points(rays @ (U @ Vt).T) - truth.image_points(rays), axis=-1)
