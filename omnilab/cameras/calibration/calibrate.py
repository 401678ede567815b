"""Calibration from checkerboards: of several camera models the one that shows best the boards it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.cameras.calibration import soundness
from omnilab.cameras.calibration.board import Corners
from omnilab.cameras.calibration.bundle import Fit, adjust, rms
from omnilab.cameras.calibration.models import MODELS, CameraModel, like
from omnilab.cameras.calibration.outliers import copies, spread_out, typical_px, wrong_corners
from omnilab.cameras.calibration.start import radial_start
from omnilab.cameras.calibration.uncertainty import covariance, picture_uncertainty_px
from omnilab.cameras.lenses import AxialCamera
from omnilab.errors import ConfigError, DataError

FOLDS = 5
ROUNDS = 3  # in which wrong corners are left out
REACH = 98  # per cent of the corners lie within what they are said to reach


@dataclass(frozen=True)
class Candidate:
    """A model as fitted to all boards, and its error on boards that it was not fitted to."""

    fit: Fit
    held_out_px: float  # rms; the poses of those boards are fitted, the camera is not


@dataclass(frozen=True)
class CalibrationResult:
    """The camera that was chosen, and why."""

    camera: AxialCamera
    chosen: Candidate
    candidates: Sequence[Candidate]
    failed: Mapping[str, str]  # models that cannot show the boards, and why
    corners: Corners  # that were fitted
    left_out: Mapping[str, str]  # pictures, and why
    wrong_corners: int  # left out of boards that were fitted
    reach_px: float  # from the axis to where corners were seen
    rim_px: float  # from the axis to the rim, or to the nearest edge of the frame
    covariance: Floats  # of the model's free settings, in their own units
    uncertainty_px: Mapping[float, float]  # standard deviation of where a ray at an angle in degrees appears


def calibrate(
    corners: Corners,
    models: Sequence[CameraModel] = tuple(MODELS.values()),
    rim_px: float | None = None,
    inner_px: float = 0.0,
    looks: str = "down",
    stage: Callable[[str], object] = lambda _: None,
) -> CalibrationResult:
    """The camera of the corners of one board in several pictures.

    `rim_px` and `inner_px` bound what the camera shows of the world, `looks` says where its axis points; `stage` is
    told what is being done. DataError if the boards determine no camera.
    """
    import scipy.optimize  # noqa: F401  its threads are limited only once they are there
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # those for matrices this small only wait for each other
        return _calibrate(corners, models, rim_px, inner_px, looks, stage)


def _calibrate(
    corners: Corners,
    models: Sequence[CameraModel],
    rim_px: float | None,
    inner_px: float,
    looks: str,
    stage: Callable[[str], object],
) -> CalibrationResult:
    boards, left_out = _distinct(corners)
    soundness.check_enough(boards, len(corners.names))
    stage("a start, and wrong corners")
    fits, failed = _robust_fits(boards, models)
    judge = min(fits, key=typical_px)
    kept, rows, wrong = _without_wrong(boards, judge)
    soundness.check_kept(kept, boards, judge)
    left_out |= {boards.names[i]: f"is off by {judge.board_rms_px[i]:.1f} px" for i in np.flatnonzero(~rows)}
    candidates = []
    for fit in fits:
        stage(fit.model.name)
        candidates += _candidates(fit, rows, kept, failed)
    chosen = min(candidates, key=lambda candidate: candidate.held_out_px)
    soundness.check_error(chosen.fit, kept)
    camera = replace(chosen.fit.camera, rim_px=rim_px, inner_px=inner_px, looks=looks)
    reach, rim = _reach_px(camera, kept), rim_px or _to_edge_px(camera)
    soundness.check_reach(reach, rim)
    angles = np.linspace(0, _largest_rad(chosen.fit.camera, kept), 7)[1:]
    uncertainty = picture_uncertainty_px(chosen.fit, angles)
    soundness.check_sure(uncertainty, chosen.fit, kept.board)
    return CalibrationResult(
        camera, chosen, candidates, failed, kept, left_out, wrong, reach, rim, covariance(chosen.fit),
        dict(zip(np.rad2deg(angles).tolist(), uncertainty.tolist(), strict=True)),
    )  # fmt: skip


def _distinct(corners: Corners) -> tuple[Corners, dict[str, str]]:
    """Boards that differ from one another, at most as many as are fitted; and the others, and why."""
    same = copies(corners)
    left_out = {corners.names[i]: f"shows the board where {corners.names[j]} does" for i, j in same.items()}
    distinct = corners.at([i for i in range(len(corners.names)) if i not in same])
    chosen = spread_out(distinct)
    others = set(distinct.names) - {distinct.names[i] for i in chosen}
    left_out |= dict.fromkeys(sorted(others), f"is not needed beside {len(chosen)} others")
    return distinct.at(chosen), left_out


def _robust_fits(boards: Corners, models: Sequence[CameraModel]) -> tuple[list[Fit], dict[str, str]]:
    """A robust fit of each model that can show the boards, and why others cannot; DataError if none can."""
    start = radial_start(boards)
    largest = _largest_rad(start.camera, boards)
    fits, failed = [], {}
    for model in models:
        try:
            fits.append(adjust(model, like(model, start.camera, largest), start.R, start.t, boards, robust=True))
        except ConfigError as error:
            failed[model.name] = str(error)
    if not fits:
        raise DataError(next(iter(failed.values())))
    return fits, failed


def _without_wrong(boards: Corners, fit: Fit) -> tuple[Corners, Bools, int]:
    """What is left without wrong corners, of which boards that is, and how many corners these have lost."""
    kept, rows, lost = boards, np.ones(len(boards.names), bool), 0
    for _ in range(ROUNDS):
        wrong = wrong_corners(fit) & kept.seen
        whole = np.asarray((kept.seen & ~wrong).any(1))
        if not wrong.any() or not whole.any():
            break
        lost += int(wrong[whole].sum())
        kept = kept.without(wrong).at(whole)
        rows[rows] = whole
        fit = adjust(fit.model, fit.values, fit.R[whole], fit.t[whole], kept, robust=True)
    return kept, rows, lost


def _candidates(fit: Fit, rows: Bools, kept: Corners, failed: dict[str, str]) -> list[Candidate]:
    """A model, fitted to the boards that are kept; none, and `failed` says why, if it cannot show them."""
    try:
        final = adjust(fit.model, fit.values, fit.R[rows], fit.t[rows], kept)
        return [Candidate(final, _held_out_px(final, kept))]
    except ConfigError as error:
        failed[fit.model.name] = str(error)
        return []


def _held_out_px(fit: Fit, kept: Corners) -> float:
    """The rms error on boards that the camera was not fitted to: each fifth of them in turn."""
    errors = []
    numbers = np.arange(len(kept.names))
    for fold in range(FOLDS):
        out = numbers % FOLDS == fold
        others = adjust(fit.model, fit.values, fit.R[~out], fit.t[~out], kept.at(~out))
        errors.append(
            adjust(fit.model, others.values, fit.R[out], fit.t[out], kept.at(out), camera_too=False).errors_px
        )
    return rms(np.concatenate(errors))


def _largest_rad(camera: AxialCamera, boards: Corners) -> float:
    """The largest angle to the axis at which a corner is seen."""
    return float(np.nanmax(np.arccos(np.clip(camera.rays(boards.pixels)[..., 2], -1, 1))))


def _reach_px(camera: AxialCamera, boards: Corners) -> float:
    distance = np.linalg.norm(boards.pixels - [camera.cx, camera.cy], axis=-1)
    return float(np.nanpercentile(distance, REACH))


def _to_edge_px(camera: AxialCamera) -> float:
    """From the axis to the nearest edge of the frame."""
    return min(camera.cx, camera.cy, camera.width - 1 - camera.cx, camera.height - 1 - camera.cy) + 0.5
