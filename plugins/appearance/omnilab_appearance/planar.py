"""The relative pose of two cameras that stand upright on one plane, from directions that show the same points."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats
from omnilab.geometry import wrap_angle

STILL = 3.0  # a mean parallax of fewer standard deviations of a direction tells no direction of motion
VAGUE_RAD = 0.5  # a direction of motion with a larger standard deviation is none
LOSS = 0.3  # width of the loss, of the tolerance
NARROW = np.deg2rad(0.02)  # features are never placed better than that


class Solver(Enum):
    """What makes a motion of a few matches."""

    two_point = "two_point"  # the least that tells it, in closed form
    linear = "linear"  # four, by the entries of the essential matrix (Gil et al., eq. 15-20)


class RelativePose(NamedTuple):
    """How a camera turned and moved, or why that cannot be told."""

    phi_rad: float  # its turn, counter-clockwise
    beta_rad: float  # where to it moved, in its first frame
    covariance: Floats  # (2, 2) of both
    agree: Bools  # (M,) which matches it explains
    parallax_rad: float  # root mean square, of those
    failed: str = ""  # in a few words; a turn may be told none the less
    turned: bool = True  # whether phi is told


def relative_pose(
    p: Floats, q: Floats, rng: np.random.Generator, solver: Solver = Solver.two_point, tolerance_rad: float = 0.006,
    draws: int = 300, least: int = 20,
) -> RelativePose:  # fmt: skip
    """The motion that most matches agree with (RANSAC, truncated squares), refined by least squares over these.

    `p`, `q` (M, 3): unit directions in the first and in the second camera's frame. What agrees lies within
    `tolerance_rad` of the epipolar constraint of planar motion (Gil et al., eq. 15, its third cosine a sine). Which way
    along the line of motion: towards where matched rays meet before both cameras. Fails where fewer than `least`
    matches agree, or where there is no parallax to tell a direction.
    """
    from omnilab_appearance._planar_kernels import best_of_pairs, parallax, refined

    p, q = np.ascontiguousarray(p, np.float64), np.ascontiguousarray(q, np.float64)
    nobody = np.zeros(len(p), bool)
    if len(p) < max(least, 4):
        return _failed(nobody, f"{len(p)} features match")
    cut = tolerance_rad**2
    if solver is Solver.two_point:
        phi, beta, _ = best_of_pairs(p, q, rng.integers(0, len(p), (draws, 2)), cut)
    else:
        phi, beta = linear_ransac(p, q, rng, cut, draws)
    phi, beta, sigma, covariance = refined(p, q, phi, beta, (LOSS * tolerance_rad) ** 2)
    off = angles(p, q, phi, beta)
    agree = off < tolerance_rad
    if agree.sum() < least:
        return _failed(agree, f"{agree.sum()} of {len(p)} matches agree")
    votes, squares = parallax(p, q, phi, beta, cut)
    spread = max(sigma, NARROW)
    covariance = covariance * (spread / max(sigma, 1e-12)) ** 2
    motion = RelativePose(
        float(wrap_angle(phi)), float(wrap_angle(beta if votes > 0 else beta + np.pi)), covariance, agree, float(np.sqrt(squares))
    )  # fmt: skip
    if np.sqrt(squares) < STILL * spread:
        return motion._replace(failed="nothing moved but by a turn")
    if not np.sqrt(covariance[1, 1]) < VAGUE_RAD:
        return motion._replace(failed="the matches tell no direction of motion")
    return motion


def _failed(agree: Bools, why: str) -> RelativePose:
    return RelativePose(np.nan, np.nan, np.full((2, 2), np.inf), agree, np.nan, why, turned=False)


def angles(p: Floats, q: Floats, phi: float, beta: float) -> Floats:
    """How far matches (M, 3) are from the epipolar constraint, (M,) in radians (Sampson, 1982, on the sphere)."""
    cg, sg, cb, sb = np.cos(beta - phi), np.sin(beta - phi), np.cos(beta), np.sin(beta)
    a, b = q[:, 1] * cg - q[:, 0] * sg, p[:, 0] * sb - p[:, 1] * cb
    r = p[:, 2] * a + q[:, 2] * b
    steep = q[:, 2] ** 2 + a**2 + p[:, 2] ** 2 + b**2 - 2 * r**2
    return np.asarray(np.abs(r) / np.sqrt(np.maximum(steep, 1e-12)))


def turned_back(q: Floats, phi_rad: float) -> Floats:
    """Directions (M, 3) of the second camera, in axes parallel to the first one's."""
    c, s = np.cos(phi_rad), np.sin(phi_rad)
    return np.column_stack([c * q[:, 0] - s * q[:, 1], s * q[:, 0] + c * q[:, 1], q[:, 2]])


# ----------------------------------------------------------------------------------------------------------- as printed
def linear_ransac(p: Floats, q: Floats, rng: np.random.Generator, cut: float, draws: int) -> tuple[float, float]:
    """Four matches at a time (eq. 20), their motion by the essential matrix, the one of the least truncated squares."""
    samples = rng.integers(0, len(p), (draws, 4))
    best, found = np.inf, (0.0, 0.0)
    for phi, beta in linear(p[samples], q[samples]):
        total = np.minimum(angles(p, q, phi, beta) ** 2, cut).sum()
        if total < best:
            best, found = total, (float(phi), float(beta))
    return found


def linear(p: Floats, q: Floats) -> Floats:
    """Motions (B, 2), turn and line of motion, of B sets of K >= 4 matches (B, K, 3), by the four entries of E.

    E has e13, e23, e31 and e32 alone (eq. 15): (e31, e32) = (sin beta, -cos beta), (e13, e23) = (-sin gamma, cos gamma),
    up to one factor. With planar motion, two of the four pairs (R, T) that an essential matrix stands for (eq. 16-19)
    tilt the camera by half a turn, and the other two differ by the sign of T: which, parallax tells.
    """
    rows = np.stack([p[..., 2] * q[..., 1], -p[..., 2] * q[..., 0], -q[..., 2] * p[..., 1], q[..., 2] * p[..., 0]], -1)
    x = np.linalg.svd(rows)[2][..., -1, :]  # cos gamma, sin gamma, cos beta, sin beta
    beta = np.arctan2(x[..., 3], x[..., 2])
    return np.stack([beta - np.arctan2(x[..., 1], x[..., 0]), beta], -1)
