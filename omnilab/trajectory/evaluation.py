"""Evaluation of trajectories: alignment, absolute and relative errors (ATE, RPE), drift.

Trajectories are poses (N, 4, 4), estimate and truth of the same instants. Errors are those of Sturm et al. (2012) and
Geiger et al. (2012), as evo computes them.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.geometry import Similarity, procrustes, quaternion_xyzw
from omnilab.posegraph.graph import inverse

KITTI_SHARES = np.arange(1, 9) / 10  # of the whole path: the lengths over which drift is measured


class Alignment(Enum):
    """How an estimate may be moved onto the truth before it is measured. Never mirrored."""

    none = "none"
    first = "first"  # first pose onto first pose
    se2 = "se2"  # turned about z and shifted
    se3 = "se3"  # turned and shifted
    sim2 = "sim2"  # scaled, turned about z and shifted
    sim3 = "sim3"  # scaled, turned and shifted


class Evaluation(NamedTuple):
    """Errors of a trajectory, after its alignment. NaN where there is nothing to measure."""

    ate_m: float  # root mean square of the distances between positions
    ate_max_m: float
    scale: float  # what the estimate was multiplied by: 1 unless the alignment may scale
    rpe_step_m: float  # root mean square of the relative translation's error, from pose to pose
    rpe_step_rad: float  # and of the relative rotation's
    rpe_metre_m: float  # the same over a metre of the true path
    rpe_metre_rad: float
    drift: float  # mean error of translation over its length, of stretches of 10 to 80 % of the path
    end_drift: float  # how far the last pose is off with the first ones brought together, over the path's length


def evaluate(estimate: Floats, truth: Floats, alignment: Alignment) -> Evaluation:
    """All errors of an estimate (N, 4, 4) with respect to the truth (N, 4, 4); N at least 2."""
    moved, scale = aligned(estimate, truth, alignment)
    error_m = np.linalg.norm(moved[:, :3, 3] - truth[:, :3, 3], axis=1)
    step = relative_errors(moved, truth, np.column_stack([np.arange(len(truth) - 1), np.arange(1, len(truth))]))
    metre = relative_errors(moved, truth, pairs_apart(truth, 1.0))
    length = float(path_length(truth)[-1])
    end = relative_errors(moved, truth, np.array([[0, len(truth) - 1]]))[0][0]
    return Evaluation(
        ate_m=rms(error_m),
        ate_max_m=float(error_m.max()),
        scale=scale,
        rpe_step_m=rms(step[0]),
        rpe_step_rad=rms(step[1]),
        rpe_metre_m=rms(metre[0]),
        rpe_metre_rad=rms(metre[1]),
        drift=_drift(moved, truth),
        end_drift=float(end / length) if length > 0 else float("nan"),
    )


def aligned(estimate: Floats, truth: Floats, alignment: Alignment) -> tuple[Floats, float]:
    """The estimate (N, 4, 4), moved as closely onto the truth (N, 4, 4) as the alignment allows, and its scale."""
    _check(estimate, truth)
    scale, R, t = _motion(estimate, truth, alignment)
    moved = estimate.copy()
    moved[:, :3, 3] = Similarity(scale, R, t).apply(estimate[:, :3, 3])
    moved[:, :3, :3] = R @ estimate[:, :3, :3]
    return moved, float(scale)


def _motion(estimate: Floats, truth: Floats, alignment: Alignment) -> Similarity:
    """What moves the estimate onto the truth."""
    if alignment is Alignment.none:
        return Similarity(np.ones(()), np.eye(3), np.zeros(3))
    if alignment is Alignment.first:
        T = truth[0] @ inverse(estimate[0])
        return Similarity(np.ones(()), T[:3, :3], T[:3, 3])
    p, q = estimate[:, :3, 3], truth[:, :3, 3]
    moves = bool((np.ptp(q, axis=0) > 0).any())  # onto one point, any estimate would fit with scale 0
    scaled = alignment in {Alignment.sim2, Alignment.sim3} and moves
    if alignment in {Alignment.se3, Alignment.sim3}:
        return procrustes(p, q, scale=scaled, reflection=False)
    flat = procrustes(p[:, :2], q[:, :2], scale=scaled, reflection=False)
    R = np.eye(3)
    R[:2, :2] = flat.R
    return Similarity(flat.scale, R, np.append(flat.t, np.mean(q[:, 2] - flat.scale * p[:, 2])))


def relative_errors(estimate: Floats, truth: Floats, pairs: Ints) -> tuple[Floats, Floats]:
    """Errors of the motions between pairs of poses (M, 2): of translation in metres, of rotation in radians, (M,) each."""
    motions = [inverse(T[pairs[:, 0]]) @ T[pairs[:, 1]] for T in (truth, estimate)]
    E = inverse(motions[0]) @ motions[1]
    q = quaternion_xyzw(E)
    return np.linalg.norm(E[:, :3, 3], axis=1), 2 * np.arctan2(np.linalg.norm(q[:, :3], axis=1), q[:, 3])


def path_length(T: Floats) -> Floats:
    """Metres (N,) along the path from the first pose to each."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)))


def pairs_apart(truth: Floats, metres: float) -> Ints:
    """Pairs (M, 2) of poses with so much of the true path between them, one behind the other."""
    along, pairs, start = path_length(truth), [], 0
    for i in range(len(along)):
        if along[i] - along[start] >= metres:
            pairs.append((start, i))
            start = i
    return np.array(pairs, int).reshape(-1, 2)


def rms(values: Floats) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _drift(estimate: Floats, truth: Floats) -> float:
    """Mean of error over length, of all stretches of 10, 20, ... 80 % of the path that start at a pose."""
    along = path_length(truth)
    shares = []
    for length in KITTI_SHARES * along[-1]:
        ends = np.searchsorted(along, along + length * (1 - 1e-9))
        starts = np.flatnonzero((ends < len(along)) & (length > 0))
        pairs = np.column_stack([starts, ends[starts]])
        shares.append(relative_errors(estimate, truth, pairs)[0] / np.maximum(length, 1e-300))
    every = np.concatenate(shares)
    return float(every.mean()) if len(every) else float("nan")


def _check(estimate: Floats, truth: Floats) -> None:
    if estimate.shape != truth.shape or estimate.shape[1:] != (4, 4) or len(truth) < 2:
        raise DataError(
            f"poses {estimate.shape} cannot be measured by poses {truth.shape}; give (N, 4, 4) of both, N at least 2"
        )
    if not (np.isfinite(estimate).all() and np.isfinite(truth).all()):
        raise DataError("a trajectory holds NaN or infinity; leave such poses out")
