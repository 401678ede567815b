"""Consistency of an estimator: NEES and its bounds, covariance ellipses."""

from __future__ import annotations

import math

import numpy as np

from omnilab.api import Floats
from omnilab.geometry import wrap_angle


def errors(estimate: Floats, truth: Floats) -> Floats:
    """Estimate less truth of poses (..., 3): metres, metres, radians in [-pi, pi)."""
    off = estimate - truth
    off[..., 2] = wrap_angle(off[..., 2])
    return np.asarray(off)


def nees(error: Floats, covariance: Floats) -> Floats:
    """Normalised estimation error squared e^T P^-1 e (...,) of errors (..., d) with covariances (..., d, d)."""
    return np.asarray((error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1))


def nees_bounds(runs: int, dof: int = 3, probability: float = 0.95) -> tuple[float, float]:
    """Bounds of the mean NEES of so many runs, with a probability, if covariances are true (Bar-Shalom, 2001)."""
    tail = (1 - probability) / 2
    return chi2_quantile(tail, runs * dof) / runs, chi2_quantile(1 - tail, runs * dof) / runs


def chi2_quantile(probability: float, dof: int) -> float:
    """Quantile of the chi2 distribution, by bisection."""
    low, high = 0.0, dof + 20 * math.sqrt(2 * dof) + 100
    while high - low > 1e-12 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _chi2_below(middle, dof) < probability else (low, middle)
    return high


def _chi2_below(value: float, dof: int) -> float:
    """Cumulative chi2 distribution: the incomplete gamma function's series (Abramowitz and Stegun, 6.5.29)."""
    a, x = dof / 2, value / 2
    if x == 0:
        return 0.0
    term, total, n = 1.0, 1.0, 0
    while term > 1e-17 * total:
        n += 1
        term *= x / (a + n)
        total += term
    return math.exp(a * math.log(x) - x - math.lgamma(a + 1)) * total


def ellipses(position_m: Floats, covariance: Floats, sigmas: float = 2.0, corners: int = 36) -> Floats:
    """Covariance ellipses (N, corners, 2) about positions (N, 2) with covariances (N, 2, 2), of so many standard deviations."""
    values, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    scaled = axes * np.sqrt(np.maximum(values, 0))[:, None, :]
    return np.asarray(position_m[:, None] + sigmas * circle @ scaled.transpose(0, 2, 1))
