"""Relative pose of two omnidirectional images under planar motion."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, ImageFeatures
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.spherical_features import directions_of, match_features

FINEST_RAD = 1e-6  # of a direction: the rounding of float32
PARALLAX_SIGMA = 5.0  # fewer standard deviations of parallax show no direction of motion
CORRELATED = (
    2.0  # factor on covariances of image matches, whose errors correlate: neighbours share their resampling (measured)
)
WIDEST_RAD = 0.5  # standard deviation of a direction of motion that is still one


class Solver(Enum):
    """The minimal solver of RANSAC."""

    two_point = "two_point"
    linear = "linear"


class RelativePose(NamedTuple):
    """The second camera in the frame of the first: rotation phi and direction of translation beta, up to scale."""

    phi: float  # radians in [-pi, pi), NaN without an estimate
    beta: float  # radians in [-pi, pi), NaN without parallax
    covariance: Floats  # (2, 2) of phi and beta; infinite for a NaN beta
    agree: Bools  # (M,) inliers: in one plane with the translation, on one side of it
    noise_rad: float  # standard deviation of a direction across its epipolar line
    failed: str = ""  # why phi or beta is missing, in a few words


def relative_pose(
    before: ImageFeatures,
    now: ImageFeatures,
    rng: np.random.Generator,
    ratio: float = 0.8,
    solver: Solver = Solver.two_point,
    tolerance_deg: float = 0.5,
    draws: int = 300,
    least_matches: int = 12,
) -> RelativePose:
    """The relative pose of two images from their features; `agree` is of `match_features(before, now, ratio)`."""
    i, j = match_features(before, now, ratio)
    p, q = directions_of(before)[i], directions_of(now)[j]
    return pose_of(p, q, rng, solver, tolerance_deg, draws, least_matches, CORRELATED)


def pose_of(
    p: Floats,
    q: Floats,
    rng: np.random.Generator,
    solver: Solver = Solver.two_point,
    tolerance_deg: float = 0.5,
    draws: int = 300,
    least_matches: int = 12,
    correlated: float = 1.0,
) -> RelativePose:
    """The planar motion that explains matched unit directions p and q (M, 3), p of the first image.

    RANSAC over the two unknowns, Gauss-Newton on Sampson's error, the half-turn by the parallax (of the linear solver by
    reprojection). With fewer inliers than `least_matches` it fails. The covariance is that of independent errors, times
    `correlated`.
    """
    from omnilab_appearance.common.planar_kernels import beside, planar_motion

    size = 2 if solver is Solver.two_point else 4
    if len(p) < max(least_matches, size):
        return _failed(len(p), f"{len(p)} matches")
    p, q = np.ascontiguousarray(p, np.float64), np.ascontiguousarray(q, np.float64)
    tolerance = np.deg2rad(tolerance_deg)
    samples = rng.integers(0, len(p), (draws, size))
    phi, beta, vp, vb, cov, noise, count, parallax, rotation, variance = planar_motion(
        p, q, samples, tolerance, FINEST_RAD
    )
    if count < least_matches:
        return _failed(len(p), f"{int(count)} of {len(p)} matches agree")
    agree = (sampson_errors(p, q, phi, beta) < tolerance) & beside(p, q, beta - phi, beta, tolerance)
    if parallax < PARALLAX_SIGMA or vb > WIDEST_RAD**2:
        covariance = np.diag([correlated * variance, np.inf])
        return RelativePose(
            float(rotation), np.nan, covariance, agree, noise, "no parallax: only the rotation is estimated"
        )
    if solver is Solver.linear:
        phi, beta = decompose(essential(phi, beta), p[agree], q[agree])
    covariance = correlated * np.array([[vp, cov], [cov, vb]])
    return RelativePose(float(wrap_angle(phi)), float(wrap_angle(beta)), covariance, agree, noise)


def _failed(matches: int, why: str) -> RelativePose:
    return RelativePose(np.nan, np.nan, np.full((2, 2), np.inf), np.zeros(matches, bool), np.nan, why)


def sampson_errors(p: Floats, q: Floats, phi: float, beta: float) -> Floats:
    """Sampson errors (M,) of directions p and q (M, 3), in radians: their distances from their epipolar planes."""
    Eq, Ep = q @ essential(phi, beta).T, p @ essential(phi, beta)
    r = (p * Eq).sum(axis=1)
    return np.asarray(np.abs(r) / np.sqrt((Eq**2).sum(axis=1) + (Ep**2).sum(axis=1) - 2 * r**2 + 1e-12))


def essential(phi: float, beta: float) -> Floats:
    """E (3, 3) of planar motion, p' E q = 0 (eq. 15, for the motion of the second camera in the frame of the first)."""
    g = beta - phi
    return np.array([[0, 0, np.sin(beta)], [0, 0, -np.cos(beta)], [-np.sin(g), np.cos(g), 0]])


def decompose(E: Floats, p: Floats, q: Floats) -> tuple[float, float]:
    """phi and beta of E: that one of its four (R, T) whose points reproject best (eq. 16-19; Bunschoten and Kröse, 2003)."""
    U, _, Vt = np.linalg.svd(E)
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = [R * np.sign(np.linalg.det(R)) for R in (U @ W @ Vt, U @ W.T @ Vt)]
    candidates = [(R, sign * U[:, 2]) for R in rotations for sign in (1, -1)]
    R, t = min(candidates, key=lambda candidate: _reprojection(candidate[0], candidate[1], p, q))
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])), float(np.arctan2(t[1], t[0]))


def _reprojection(R: Floats, t: Floats, p: Floats, q: Floats) -> float:
    """Sum of squared differences between directions p, q (M, 3) and those of the triangulated points.

    A point behind a camera reprojects to the opposite direction.
    """
    rotated = q @ R.T
    cosine = (p * rotated).sum(axis=1)
    pt, qt = p @ t, rotated @ t
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    near, far = (pt - cosine * qt) / sine2, (cosine * pt - qt) / sine2  # near p = t + far rotated, in least squares
    points = (near[:, None] * p + t + far[:, None] * rotated) / 2
    first = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
    second = points - t
    second = second / np.maximum(np.linalg.norm(second, axis=1, keepdims=True), 1e-12)
    return float(((first - p) ** 2).sum() + ((second - rotated) ** 2).sum())
