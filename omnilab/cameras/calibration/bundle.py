"""Least squares over a camera and the poses of its boards: the reprojection error of every corner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.cameras.calibration.board import Corners
from omnilab.cameras.calibration.models import CameraModel, image_points
from omnilab.cameras.lenses import AxialCamera
from omnilab.errors import ConfigError

STEP = 1e-6  # of central differences, in units in which parameters are of the order of one
ROBUST_PX = 1.0  # beyond this error a corner counts less in a robust fit


@dataclass(frozen=True)
class Fit:
    """A camera and the poses of boards, lengths in squares."""

    model: CameraModel
    values: Floats  # (k) of the camera, as fitted
    camera: AxialCamera
    R: Floats  # (B, 3, 3) from the board's frame to right, down and forward
    t: Floats  # (B, 3)
    errors_px: Floats  # (B, n, 2) found minus measured; NaN where a corner is not seen
    jacobian: Floats  # (seen x 2, k + 6 B) of the errors

    @property
    def rms_px(self) -> float:
        """Root mean square of the distance between found and measured corners."""
        return rms(self.errors_px)

    @property
    def board_rms_px(self) -> Floats:
        """The same by board (B)."""
        return np.asarray(np.sqrt(np.nanmean((self.errors_px**2).sum(-1), 1)))


def rms(errors_px: Floats) -> float:
    """Root mean square length of errors (..., 2), NaN left out."""
    return float(np.sqrt(np.nanmean((errors_px**2).sum(-1))))


def adjust(
    model: CameraModel,
    values: Floats,
    R: Floats,
    t: Floats,
    corners: Corners,
    robust: bool = False,
    camera_too: bool = True,
) -> Fit:
    """The camera and the poses that show the corners where they were found; only the poses without `camera_too`.

    Started from `values`, R and t. A robust fit counts corners far off less (soft L1). ConfigError if the start shows
    nothing.
    """
    from scipy.optimize import least_squares

    problem = _Problem(model, np.asarray(values, float), R, corners, len(values) if camera_too else 0)
    start = np.concatenate([values[: problem.free], np.concatenate([np.zeros_like(t), t], 1).ravel()])
    if not np.isfinite(problem.errors(start)).all():
        raise ConfigError(f"the model {model.name} does not show all corners of the boards; give another --model")
    found = least_squares(
        problem.errors, start, problem.jacobian, x_scale="jac", loss="soft_l1" if robust else "linear",
        f_scale=ROBUST_PX, ftol=1e-9, xtol=1e-9, gtol=1e-10, max_nfev=100,
    )  # fmt: skip
    camera_values, R, t = problem.parts(found.x)
    errors = np.full((*corners.seen.shape, 2), np.nan)
    errors[corners.seen] = problem.errors(found.x).reshape(-1, 2)
    camera = model.camera(camera_values, corners.width, corners.height)
    return Fit(model, camera_values, camera, R, t, errors, problem.jacobian(found.x))


@dataclass(frozen=True)
class _Problem:
    """Errors of all corners as a function of the first `free` values of the camera and of (turn, t) of each board."""

    model: CameraModel
    values: Floats
    R: Floats  # at the start: turns are about it
    corners: Corners
    free: int

    def parts(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Values of the camera, R and t."""
        from scipy.spatial.transform import Rotation

        turn, t = np.split(x[self.free :].reshape(-1, 6), 2, axis=1)
        values = np.concatenate([x[: self.free], self.values[self.free :]])
        return values, Rotation.from_rotvec(turn).as_matrix() @ self.R, t

    def errors(self, x: Floats) -> Floats:
        """(seen x 2); NaN where the model shows nothing."""
        return (self._image(x) - self.corners.pixels)[self.corners.seen].ravel()

    def jacobian(self, x: Floats) -> Any:
        """By central differences; a pose moves its own board alone, so one step moves all."""
        seen = self.corners.seen
        J = np.zeros((int(seen.sum()), 2, len(x)))
        board = np.nonzero(seen)[0]
        for i in range(self.free):
            J[..., i] = self._slope(x, np.arange(len(x)) == i)[seen]
        for i in range(6):
            columns = self.free + i + 6 * board
            moved = np.arange(len(x)) >= self.free
            moved &= (np.arange(len(x)) - self.free) % 6 == i
            J[np.arange(len(board)), :, columns] = self._slope(x, moved)[seen]
        return np.nan_to_num(J.reshape(-1, len(x)))

    def _slope(self, x: Floats, moved: Bools) -> Floats:
        step = STEP * moved
        return (self._image(x + step) - self._image(x - step)) / (2 * STEP)

    def _image(self, x: Floats) -> Floats:
        """Where the corners (B, n, 2) appear; NaN for a camera that is none."""
        values, R, t = self.parts(x)
        rays = self.corners.board.points @ np.swapaxes(R, 1, 2) + t[:, None]
        return image_points(self.model, values, (self.corners.width, self.corners.height), rays)
