"""Calibration of cameras with one viewpoint from pictures of a checkerboard."""

from omnilab.cameras.calibration.board import Board, Corners
from omnilab.cameras.calibration.calibrate import CalibrationResult, Candidate, calibrate
from omnilab.cameras.calibration.corner_file import read_corners, write_corners
from omnilab.cameras.calibration.corners import find_corners, other_board
from omnilab.cameras.calibration.grid import whole_size
from omnilab.cameras.calibration.models import MODELS, CameraModel, like
from omnilab.cameras.calibration.refit import Refit, refit
from omnilab.cameras.calibration.rendering import board_poses, render_board, shown_corners

__all__ = [
    "MODELS",
    "Board",
    "CalibrationResult",
    "CameraModel",
    "Candidate",
    "Corners",
    "Refit",
    "board_poses",
    "calibrate",
    "find_corners",
    "like",
    "other_board",
    "read_corners",
    "refit",
    "render_board",
    "shown_corners",
    "whole_size",
    "write_corners",
]
