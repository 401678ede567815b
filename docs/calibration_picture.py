"""Draws the picture of docs/calibration.md, of rendered boards: uv run python docs/calibration_picture.py"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from omnilab.cameras import UnifiedCamera
from omnilab.cameras.calibration import Board, board_poses, render_board
from omnilab_recordings.checkerboards.command import calibrate_command

PICTURE = Path(__file__).parent / "pictures/calibration.png"
BOARD = Board(6, 7, 0.03)
MIRROR = UnifiedCamera(width=640, height=480, cx=323.2, cy=237.5, fx=265.0, fy=264.5, xi=0.95)
COUNT = 14


def main() -> None:
    """Render boards around the mirror, with the blur and noise of a camera, and calibrate by them."""
    i = np.arange(COUNT)
    directions = np.column_stack([np.array([35, 50, 62, 75])[i % 4], i * 137.5])
    tilts = np.column_stack([25.0 * (-1.0) ** i, 15.0 * (i % 3 - 1)])
    R, t = board_poses(BOARD, directions, 7 + 2 * (i % 3), tilts, 47.0 * i)
    rng = np.random.default_rng(0)
    v, u = np.mgrid[: MIRROR.height, : MIRROR.width]
    dark = np.hypot(u - MIRROR.cx, v - MIRROR.cy) > 235
    with TemporaryDirectory() as folder:
        for number in i:
            image = cv2.GaussianBlur(render_board(MIRROR, BOARD, R[number], t[number], 3), (0, 0), 0.8)
            image[dark] = 5
            noisy = image + rng.normal(0, 4, image.shape)
            cv2.imwrite(f"{folder}/board-{number:02}.png", np.clip(noisy, 0, 255).astype(np.uint8))
        with TemporaryDirectory() as output:
            settings = ["--board", "6x7", "--square", "30mm", "-o", f"{output}/camera.json"]
            calibrate_command([folder, *settings])
            PICTURE.write_bytes((Path(output) / "camera.png").read_bytes())


if __name__ == "__main__":
    main()
