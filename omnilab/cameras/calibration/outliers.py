"""What is left out of a fit: pictures of the same pose, boards and corners that were found wrongly."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.cameras.calibration.board import Corners
from omnilab.cameras.calibration.bundle import Fit

SAME_PX = 1.0  # median distance of the corners of two pictures of one pose, at most
SIGMAS = 6.0  # of the errors' robust spread, from which on a corner is wrong
LEAST_PX = 0.5  # error of a wrong corner, at least
MOST_WRONG = 1 / 3  # of a board's corners; with more the board is wrong
MOST_BOARDS = 60  # that are fitted: time grows with their third power, and what they tell with its root
MEDIAN_OF_RAYLEIGH = np.sqrt(2 * np.log(2))  # of distances, for errors of spread 1 along each axis


def copies(corners: Corners) -> dict[int, int]:
    """Pictures that show the board where an earlier one does, and that one."""
    found: dict[int, int] = {}
    for later in range(1, len(corners.names)):
        apart = np.linalg.norm(corners.pixels[:later] - corners.pixels[later], axis=-1)
        near = np.nanmedian(np.where(np.isfinite(apart), apart, np.inf), 1)
        if near.min() < SAME_PX:
            found[later] = int(near.argmin())
    return found


def spread_out(corners: Corners) -> Ints:
    """Up to `MOST_BOARDS` pictures that differ most in where and how large the board is: each the farthest from those before."""
    if len(corners.names) <= MOST_BOARDS:
        return np.arange(len(corners.names))
    middle = np.nanmean(corners.pixels, 1) / np.hypot(corners.width, corners.height)
    place = np.column_stack([middle, np.log(corners.spacing_px) / 4])
    chosen = [0]
    distance = np.linalg.norm(place - place[0], axis=1)
    while len(chosen) < MOST_BOARDS:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(place - place[chosen[-1]], axis=1))
    return np.sort(chosen)


def wrong_corners(fit: Fit) -> Bools:
    """Which corners (B, n) lie farther off a robust fit than the others' spread explains; of wrong boards all."""
    distance = np.linalg.norm(fit.errors_px, axis=-1)
    spread = np.nanmedian(distance) / MEDIAN_OF_RAYLEIGH
    with np.errstate(invalid="ignore"):
        wrong = distance > max(SIGMAS * spread, LEAST_PX)
    share = wrong.sum(1) / np.isfinite(distance).sum(1)
    return np.asarray(wrong | (share > MOST_WRONG)[:, None])


def typical_px(fit: Fit) -> float:
    """The median distance between found and measured corners, which wrong boards hardly move."""
    errors: Floats = np.linalg.norm(fit.errors_px, axis=-1)
    return float(np.nanmedian(errors))
