"""Fits that mean nothing: each is refused in a sentence that says which pictures would help."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.calibration.board import Board, Corners
from omnilab.cameras.calibration.bundle import Fit
from omnilab.errors import DataError

FEWEST_BOARDS = 5
MOST_LEFT_OUT = 0.4  # of the boards
LARGEST_PX, LARGEST_SHARE = 1.0, 0.04  # rms error: in pixels, and in parts of the distance between corners
LEAST_REACH = 0.6  # of the radius to the rim, that corners must reach
LEAST_SURE_PX = 1.0  # standard deviation of where a ray appears, at most


def check_enough(corners: Corners, found_in: int) -> None:
    """DataError for fewer boards than a camera can be fitted to and tested on."""
    count = len(corners.names)
    if count < FEWEST_BOARDS:
        raise DataError(
            f"{count} board(s) of {corners.board} corners in {found_in} picture(s) are too few for a calibration; take"
            f" {FEWEST_BOARDS} or more, better 15, with the board tilted, near and far, and all around the picture"
        )


def check_kept(kept: Corners, all_: Corners, fit: Fit) -> None:
    """DataError if a fit holds for too few of the boards."""
    count, of = len(kept.names), len(all_.names)
    if count < max(FEWEST_BOARDS, (1 - MOST_LEFT_OUT) * of):
        raise DataError(
            f"only {count} of {of} boards fit one camera (the others are off by"
            f" {np.nanmax(fit.board_rms_px):.0f} px and the like); give pictures of one camera with one focus, and a flat board of"
            f" {kept.board} inner corners"
        )


def check_error(fit: Fit, corners: Corners) -> None:
    """DataError for errors that no corner of a right board has."""
    share = fit.rms_px / float(np.median(corners.spacing_px))
    if fit.rms_px > LARGEST_PX and share > LARGEST_SHARE:
        raise DataError(
            f"the best camera misses the corners by {fit.rms_px:.1f} px rms, {share:.0%} of the distance between them, which is no"
            f" calibration; look whether the board has {corners.board} inner corners, is flat, and is in focus"
        )


def check_reach(reach_px: float, rim_px: float) -> None:
    """DataError if the picture's outer part shows no corners."""
    if reach_px < LEAST_REACH * rim_px:
        raise DataError(
            f"the corners reach {reach_px:.0f} px from the axis, {reach_px / rim_px:.0%} of the {rim_px:.0f} px to the rim, and"
            " nothing is known beyond; take pictures with the board at the rim, or give --rim"
            f" {int(reach_px / LEAST_REACH)} or less if no more of the picture will be used"
        )


def check_sure(uncertainty_px: Floats, fit: Fit, board: Board) -> None:
    """DataError if the boards do not determine the camera."""
    worst = float(np.max(uncertainty_px))
    if not worst <= LEAST_SURE_PX:
        known = f"only to {worst:.1f} px" if np.isfinite(worst) else "not at all"
        raise DataError(
            f"the boards are too much alike: {_alike(fit, board)}, and by them the camera is known {known};"
            " take pictures with the board tilted by 30 degrees and more to all sides, near and far, all around the picture"
        )


def _alike(fit: Fit, board: Board) -> str:
    """How much boards differ in tilt and distance."""
    middle = fit.R @ board.points.mean(0) + fit.t
    distance = np.linalg.norm(middle, axis=1)
    line_of_sight = middle / distance[:, None]
    tilt = np.rad2deg(np.arccos(np.clip(np.abs((fit.R[..., 2] * line_of_sight).sum(-1)), 0, 1)))
    return f"they are tilted by {tilt.min():.0f} to {tilt.max():.0f} degrees, at {distance.min():.3g} to {distance.max():.3g} squares"
