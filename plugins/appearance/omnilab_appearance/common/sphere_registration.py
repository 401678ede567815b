"""Normalised correlation of two spheres, of which each camera may see a part, and the rotation at its peak."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from omnilab.api import Floats
from omnilab_appearance.common.so3_correlation import at_rotations, correlate
from omnilab_appearance.common.spherical_harmonics import Complexes, rotation_zyz, zyz_of

NOISE = 1e-2  # of a picture's variance: where the overlap varies less, its correlation is rounding
PARTS = 3  # m f, m f^2, m
ROUNDS = 4  # of the refinement
STENCIL = np.array(  # rotation vectors, in steps: the centre, both ways along the axes and the diagonals between them
    [v for v in product((0, 1, -1), repeat=3) if sum(map(abs, v)) < 3], float
)


def peaks(one: Complexes, others: Complexes, betas_rad: Floats, least_overlap: float) -> tuple[Floats, Floats]:
    """The highest normalised correlation (P,) of a sphere (3, L, M) with P others (P, 3, L, M) on a grid of rotations.

    And the rotation there (P, 3, 3), which takes directions of the others' frames to the one's.
    """
    found = normalized(one, others, lambda a, b: correlate(a, b, betas_rad), least_overlap)
    best = found.reshape(len(others), -1).argmax(axis=1)
    k, i, j = np.unravel_index(best, found.shape[1:])
    step = 2 * np.pi / found.shape[-1]
    return found.reshape(len(others), -1)[np.arange(len(best)), best], rotation_zyz(i * step, betas_rad[k], j * step)


def refined(
    one: Complexes, other: Complexes, R: Floats, step_rad: float, least_overlap: float, largest_tilt_rad: float = np.pi
) -> tuple[float, Floats]:
    """The correlation and the rotation (3, 3) at the peak near R, by Newton's steps on quadratics fitted around it.

    Each round looks half as far as the one before, and keeps the best rotation of all it tried. Those that tilt z axes
    apart by more than `largest_tilt_rad` are brought back to that.
    """
    best = -np.inf
    for _ in range(ROUNDS):
        tries = _bounded(_exponential(step_rad * STENCIL) @ R, largest_tilt_rad)
        values = _at(one, other, tries, least_overlap)
        newton = _bounded(_exponential(step_rad * _vertex(values)[None]) @ R, largest_tilt_rad)
        tries, values = np.concatenate([tries, newton]), np.append(values, _at(one, other, newton, least_overlap))
        best, R = float(values.max()), tries[values.argmax()]
        step_rad /= 2
    return best, R


def _bounded(R: Floats, largest_tilt_rad: float) -> Floats:
    """Rotations (n, 3, 3) with the angle between the z axes at most so large."""
    alpha, beta, gamma = zyz_of(R)
    return rotation_zyz(alpha, np.minimum(beta, largest_tilt_rad), gamma)


def _vertex(values: Floats) -> Floats:
    """The vertex (3,), in steps and at most one away along each axis, of the quadratic through values at `STENCIL`.

    Along principal axes on which it does not bend down it is where it was.
    """
    x, y, z = STENCIL.T
    A = np.stack([np.ones_like(x), x, y, z, x * x / 2, y * y / 2, z * z / 2, x * y, x * z, y * z], 1)
    _, gx, gy, gz, xx, yy, zz, xy, xz, yz = np.linalg.lstsq(A, values, rcond=None)[0]
    bend, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    along = axes.T @ [gx, gy, gz]
    down = bend < -1e-9 * max(1e-9, np.abs(bend).max())
    return np.asarray(np.clip(axes @ np.divide(-along, bend, out=np.zeros(3), where=down), -1, 1))


def _at(one: Complexes, other: Complexes, R: Floats, least_overlap: float) -> Floats:
    """Normalised correlations (n,) at rotations (n, 3, 3)."""
    found = normalized(one, other[None], lambda a, b: at_rotations(a, b[0], R)[None], least_overlap)
    return np.asarray(found[0])


def normalized(
    one: Complexes, others: Complexes, correlation: Callable[[Complexes, Complexes], Floats], least_overlap: float
) -> Floats:
    """Pearson's correlation over where both see, (P, ...) as `correlation` has it; -1 where they overlap too little.

    Its means and variances over each overlap are correlations of the pictures, their squares and their masks (Padfield,
    2012, eq. 18). Whole spheres overlap everywhere, which leaves one correlation of the six, and Parseval's norms.
    """
    if _whole(one) and bool(_whole(others).all()):
        a, b = _without_mean(one[0]), _without_mean(others[:, 0])
        lengths = np.linalg.norm(a) * np.linalg.norm(b, axis=(-2, -1))
        found = correlation(a, b)
        lengths = np.maximum(lengths, NOISE).reshape(-1, *([1] * (found.ndim - 1)))
        return np.asarray(found / lengths)
    f, q, m = one
    F, Q, M = np.moveaxis(others, 1, 0)
    area = correlation(m, M)
    own, their = _integral(m), _integral(M).reshape(-1, *([1] * (area.ndim - 1)))
    enough = area > least_overlap * np.minimum(own, their)
    area = np.where(enough, area, 1.0)
    mean, MEAN = correlation(f, M) / area, correlation(m, F) / area
    variance, VARIANCE = correlation(q, M) / area - mean**2, correlation(m, Q) / area - MEAN**2
    spread = np.sqrt(np.maximum(variance, NOISE) * np.maximum(VARIANCE, NOISE))
    return np.asarray(np.where(enough, np.clip((correlation(f, F) / area - mean * MEAN) / spread, -1, 1), -1.0))


def _whole(spheres: Complexes) -> Floats:
    """Whether (...) all of spheres (..., 3, L, M) is seen."""
    return np.asarray(np.abs(_integral(spheres[..., 2, :, :]) - 4 * np.pi) < 1e-3)


def _integral(functions: Complexes) -> Floats:
    """Integrals (...) of functions (..., L, M) over the sphere."""
    return np.asarray(functions[..., 0, functions.shape[-1] // 2].real * np.sqrt(4 * np.pi))


def _without_mean(functions: Complexes) -> Complexes:
    out = functions.copy()
    out[..., 0, :] = 0
    return out


def _exponential(rotation_vectors: Floats) -> Floats:
    """Rotations (n, 3, 3) of rotation vectors (n, 3) (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(rotation_vectors).as_matrix())
