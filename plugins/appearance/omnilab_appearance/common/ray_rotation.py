"""Rotation between two sets of matched unit directions, with and without a translation."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats

LEAST = 8  # matches for a motion, which has five unknowns
PARALLAX_RAD = np.deg2rad(20.0)  # by which most directions differ at most, in a room
TRANSLATIONS = 100  # directions tried
SCALES = (4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0)  # of the tolerance, a step each


def wahba(p: Floats, q: Floats, weights: Floats | None = None) -> Floats:
    """Rotations R (..., 3, 3) that bring directions q (..., M, 3) closest to p: Wahba's problem by SVD (Markley, 1988)."""
    w = np.ones(p.shape[:-1]) if weights is None else weights
    U, _, Vt = np.linalg.svd(np.swapaxes(p * w[..., None], -1, -2) @ q)
    U[..., 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[..., None]
    return np.asarray(U @ Vt)


def robust_rotation(
    p: Floats, q: Floats, rng: np.random.Generator, tolerance_rad: float, draws: int
) -> tuple[Floats, Bools]:
    """R (3, 3) with p = R q for most of matched directions (M, 3), and which (M,) agree within a tolerance.

    RANSAC over rotations of two matches each (Fischler and Bolles, 1981), then Wahba's problem over what agrees, twice.
    With fewer than two matches it is the identity, and none agrees.
    """
    if len(p) < 2:
        return np.eye(3), np.zeros(len(p), bool)
    R = _drawn(p, q, rng, tolerance_rad, draws)[0]
    agree = (p * (q @ R.T)).sum(axis=1) > np.cos(tolerance_rad)
    for _ in range(2):
        if agree.sum() < 2:
            break
        R = wahba(p[agree], q[agree])
        agree = (p * (q @ R.T)).sum(axis=1) > np.cos(tolerance_rad)
    return R, agree


def _drawn(p: Floats, q: Floats, rng: np.random.Generator, tolerance_rad: float, draws: int) -> Floats:
    """Rotations (draws, 3, 3) of two matches each, those first that take most directions to within a tolerance."""
    first = rng.integers(0, len(p), draws)
    pairs = np.stack([first, (first + rng.integers(1, len(p), draws)) % len(p)], 1)
    candidates = wahba(p[pairs], q[pairs])
    cosine = np.einsum("mi,rij,mj->rm", p, candidates, q, optimize=True)
    return np.asarray(candidates[np.argsort(-(cosine > np.cos(tolerance_rad)).sum(axis=1), kind="stable")])


def relative_orientation(
    p: Floats, q: Floats, rng: np.random.Generator, tolerance_rad: float, draws: int, starts: int
) -> tuple[Floats, Bools]:
    """R (3, 3) of the motion that most of matched directions (M, 3) agree with, p' [t] R q = 0, and which (M,) do.

    With fewer than `LEAST` matches, which any motion would explain, it is that of `robust_rotation`.
    """
    if len(p) < LEAST:
        return robust_rotation(p, q, rng, tolerance_rad, draws)
    fits = [
        _fitted(p, q, R, _translation(p, q, R, rng, tolerance_rad), tolerance_rad)
        for R in _drawn(p, q, rng, PARALLAX_RAD, draws)[:starts]
    ]
    R, t = max(fits, key=lambda fit: float((_sampson(p, q, *fit)[0] < tolerance_rad).sum()))
    return R, _sampson(p, q, R, t)[0] < tolerance_rad


def _translation(p: Floats, q: Floats, R: Floats, rng: np.random.Generator, tolerance_rad: float) -> Floats:
    """The direction t (3,), of those that two matches each give under a rotation, with most matches in its planes."""
    normals = np.cross(p, q @ R.T)
    i, j = rng.integers(0, len(p), (2, TRANSLATIONS))
    found = np.cross(normals[i], normals[j])
    length = np.linalg.norm(found, axis=1, keepdims=True)
    found = np.where(length > 0, found / np.maximum(length, 1e-300), [1.0, 0, 0])
    off = np.abs(normals @ found.T)  # the sine of the angle from the plane, times that of the parallax
    return np.asarray(found[(off < tolerance_rad).sum(axis=0).argmax()])


def _fitted(p: Floats, q: Floats, R: Floats, t: Floats, tolerance_rad: float) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) after Gauss-Newton on Sampson's error with the weights of Geman and McClure.

    The tolerance falls from four times to once what it is, so that a start far off is not left alone.
    """
    for scale in SCALES:
        error, J, t_basis = _linearised(p, q, R, t)
        w = 1 / (1 + (error / (scale * tolerance_rad)) ** 2) ** 2
        JTJ = (J * w[:, None]).T @ J
        step = -np.linalg.solve(JTJ + 1e-6 * np.trace(JTJ) * np.eye(5) + 1e-12 * np.eye(5), (J * w[:, None]).T @ error)
        R = _exponential(step[:3]) @ R
        t = t + t_basis @ step[3:]
        t = t / np.linalg.norm(t)
    return R, t


def _linearised(p: Floats, q: Floats, R: Floats, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Signed Sampson errors (M,), their derivatives (M, 5) by a turn w of R, exp(w) R, and by t along a basis (3, 2)."""
    r = q @ R.T
    basis = np.linalg.svd(t[None])[2][1:].T
    _, length = _sampson(p, q, R, t)
    value = np.cross(p, r) @ t
    by_turn = t * (p * r).sum(axis=1, keepdims=True) - p * (r @ t)[:, None]
    return value / length, np.hstack([by_turn, np.cross(p, r) @ basis]) / length[:, None], basis


def _sampson(p: Floats, q: Floats, R: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Sampson errors (M,) of matches, radians from their epipolar planes, and the gradients' lengths (M,) they were divided by."""
    r = q @ R.T
    value = np.cross(p, r) @ t
    squares = (np.cross(r, t) ** 2).sum(axis=1) + (np.cross(t, p) ** 2).sum(axis=1) - 2 * value**2
    length = np.sqrt(np.maximum(squares, 1e-12))
    return np.abs(value) / length, length


def _exponential(rotation_vector: Floats) -> Floats:
    """The rotation (3, 3) of a rotation vector (3,) (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(rotation_vector).as_matrix())
