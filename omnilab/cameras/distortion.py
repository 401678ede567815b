"""Lens distortion along the radius (k1, k2) and aside (p1, p2), of points on the plane at depth 1 (Brown, 1966)."""

from __future__ import annotations

import math

import numpy as np

from omnilab.api import Floats

Coefficients = tuple[float, float, float, float]  # k1, k2, p1, p2
STEPS = 20


def radial(r2: Floats, k1: float, k2: float) -> Floats:
    """The factor by which distortion along the radius moves points, of the square of their radius."""
    return np.asarray(1 + k1 * r2 + k2 * r2**2)


def turning_radius(k1: float, k2: float) -> float:
    """The radius up to which radius x `radial` grows; infinity where it always does."""
    discriminant = 9 * k1**2 - 20 * k2  # of 1 + 3 k1 radius^2 + 5 k2 radius^4
    if discriminant < 0:
        return np.inf
    inverse = (math.sqrt(discriminant) - 3 * k1) / 2  # of the smallest square
    return 1 / math.sqrt(inverse) if inverse > 1e-12 else np.inf


def distorted(points: Floats, coefficients: Coefficients) -> Floats:
    """Points (..., 2) as the lens moves them."""
    k1, k2, p1, p2 = coefficients
    x, y = np.moveaxis(points, -1, 0)
    r2 = x**2 + y**2
    aside = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y], -1)
    return np.asarray(points * radial(r2, k1, k2)[..., None] + aside)


def undistorted(points: Floats, coefficients: Coefficients) -> Floats:
    """The inverse of `distorted`, by Newton's method; NaN where it does not converge to 1e-12."""
    found = np.array(points, float)
    with np.errstate(all="ignore"):  # points that no lens moves here run off
        for _ in range(STEPS):
            error = distorted(found, coefficients) - points
            xx, xy, yy = _slopes(found, coefficients)
            step = np.stack([yy * error[..., 0] - xy * error[..., 1], xx * error[..., 1] - xy * error[..., 0]], -1)
            found = found - step / (xx * yy - xy**2)[..., None]
        good = np.abs(distorted(found, coefficients) - points).max(-1) < 1e-12
        good &= np.hypot(found[..., 0], found[..., 1]) <= turning_radius(*coefficients[:2])
    return np.where(good[..., None], found, np.nan)


def _slopes(points: Floats, coefficients: Coefficients) -> tuple[Floats, Floats, Floats]:
    """The derivatives of `distorted`: of x by x, of x by y (and y by x), of y by y."""
    k1, k2, p1, p2 = coefficients
    x, y = np.moveaxis(points, -1, 0)
    r2 = x**2 + y**2
    factor, steeper = radial(r2, k1, k2), 2 * k1 + 4 * k2 * r2
    xx = factor + steeper * x**2 + 2 * p1 * y + 6 * p2 * x
    xy = steeper * x * y + 2 * p1 * x + 2 * p2 * y
    yy = factor + steeper * y**2 + 6 * p1 * y + 2 * p2 * x
    return xx, xy, yy
