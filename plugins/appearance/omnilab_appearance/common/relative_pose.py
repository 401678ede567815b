"""The relative pose of two omnidirectional images whose camera moved in the plane."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.spherical_features import Sighting, matched, on_sphere

FINEST_RAD = 1e-6  # directions are told no finer: the rounding of float32
PARALLAX_SIGMA = 5.0  # fewer standard deviations of parallax show no direction of motion
ALIKE = 2.0  # matches of images that err as one: neighbours share their resampling (measured on rendered sequences)
WIDEST_RAD = 0.5  # standard deviation of a direction of motion that is still one


class Solver(Enum):
    """How RANSAC gets a motion from few matches."""

    two_point = "two_point"
    linear = "linear"


class RelativePose(NamedTuple):
    """The second camera in the frame of the first: turned by phi, in direction beta; how far is not told."""

    phi: float  # radians in [-pi, pi), NaN if it failed altogether
    beta: float  # radians in [-pi, pi), NaN where no parallax shows it
    covariance: Floats  # (2, 2) of phi and beta; that of beta is infinite where it is not told
    agree: Bools  # (M,) which matches fit: in one plane with the step, on one side of it
    noise_rad: float  # standard deviation of a direction across its epipolar line
    failed: str = ""  # why phi or beta is missing, in a few words


def relative_pose(
    before: Sighting,
    now: Sighting,
    rng: np.random.Generator,
    ratio: float = 0.8,
    solver: Solver = Solver.two_point,
    tolerance_deg: float = 0.5,
    draws: int = 300,
    least_matches: int = 12,
) -> RelativePose:
    """How the camera moved between two sightings; `agree` is of the pairs of `matched(before, now, ratio)`."""
    i, j = matched(before, now, ratio)
    return pose_of(on_sphere(before)[i], on_sphere(now)[j], rng, solver, tolerance_deg, draws, least_matches, ALIKE)


def pose_of(
    p: Floats,
    q: Floats,
    rng: np.random.Generator,
    solver: Solver = Solver.two_point,
    tolerance_deg: float = 0.5,
    draws: int = 300,
    least_matches: int = 12,
    alike: float = 1.0,
) -> RelativePose:
    """The planar motion that explains matched unit directions p and q (M, 3), p of the first image.

    RANSAC over the two unknowns, Gauss-Newton on Sampson's error, the half-turn by the parallax (of the linear solver by
    reprojection). Fewer than `least_matches` that fit are a failure. The covariance is
    that of independent errors, times `alike`.
    """
    from omnilab_appearance.common.planar_kernels import beside, planar_motion

    size = 2 if solver is Solver.two_point else 4
    if len(p) < max(least_matches, size):
        return _failed(len(p), f"{len(p)} matches")
    p, q = np.ascontiguousarray(p, np.float64), np.ascontiguousarray(q, np.float64)
    tolerance = np.deg2rad(tolerance_deg)
    samples = rng.integers(0, len(p), (draws, size))
    phi, beta, vp, vb, cov, noise, count, parallax, turned, variance = planar_motion(
        p, q, samples, tolerance, FINEST_RAD
    )
    if count < least_matches:
        return _failed(len(p), f"{int(count)} of {len(p)} matches agree")
    agree = (errors(p, q, phi, beta) < tolerance) & beside(p, q, beta - phi, beta, tolerance)
    if parallax < PARALLAX_SIGMA or vb > WIDEST_RAD**2:
        covariance = np.diag([alike * variance, np.inf])
        return RelativePose(float(turned), np.nan, covariance, agree, noise, "no parallax: only the rotation is told")
    if solver is Solver.linear:
        phi, beta = chosen(essential(phi, beta), p[agree], q[agree])
    covariance = alike * np.array([[vp, cov], [cov, vb]])
    return RelativePose(float(wrap_angle(phi)), float(wrap_angle(beta)), covariance, agree, noise)


def _failed(matches: int, why: str) -> RelativePose:
    return RelativePose(np.nan, np.nan, np.full((2, 2), np.inf), np.zeros(matches, bool), np.nan, why)


def errors(p: Floats, q: Floats, phi: float, beta: float) -> Floats:
    """Sampson's error (M,) of directions p and q (M, 3), in radians: how far they lie from their epipolar plane."""
    Eq, Ep = q @ essential(phi, beta).T, p @ essential(phi, beta)
    r = (p * Eq).sum(axis=1)
    return np.asarray(np.abs(r) / np.sqrt((Eq**2).sum(axis=1) + (Ep**2).sum(axis=1) - 2 * r**2 + 1e-12))


def essential(phi: float, beta: float) -> Floats:
    """E (3, 3) of planar motion, p' E q = 0 (eq. 15, for the motion of the second camera in the frame of the first)."""
    g = beta - phi
    return np.array([[0, 0, np.sin(beta)], [0, 0, -np.cos(beta)], [-np.sin(g), np.cos(g), 0]])


def chosen(E: Floats, p: Floats, q: Floats) -> tuple[float, float]:
    """phi and beta of that one of the four (R, T) of E whose points reproject best (eq. 16-19; Bunschoten and Kröse, 2003)."""
    U, _, Vt = np.linalg.svd(E)
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = [R * np.sign(np.linalg.det(R)) for R in (U @ W @ Vt, U @ W.T @ Vt)]
    candidates = [(R, sign * U[:, 2]) for R in rotations for sign in (1, -1)]
    R, t = min(candidates, key=lambda candidate: _reprojection(candidate[0], candidate[1], p, q))
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])), float(np.arctan2(t[1], t[0]))


def _reprojection(R: Floats, t: Floats, p: Floats, q: Floats) -> float:
    """Sum of squared differences between directions p, q (M, 3) and those of the points in which they meet best.

    A point behind a camera reprojects to the opposite direction.
    """
    turned = q @ R.T
    cosine = (p * turned).sum(axis=1)
    pt, qt = p @ t, turned @ t
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    near, far = (pt - cosine * qt) / sine2, (cosine * pt - qt) / sine2  # near p = t + far turned, in least squares
    points = (near[:, None] * p + t + far[:, None] * turned) / 2
    first = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
    second = points - t
    second = second / np.maximum(np.linalg.norm(second, axis=1, keepdims=True), 1e-12)
    return float(((first - p) ** 2).sum() + ((second - turned) ** 2).sum())
