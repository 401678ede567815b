"""Lens distortion of points on the plane at depth 1: radial and tangential (Brown, 1966), also as a ratio (OpenCV).

Coefficients are in OpenCV's order: k1, k2, p1, p2, and where there are such k3, k4, k5, k6. With r2 the square of the
radius, a point moves along it by (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3), and aside by p1, p2.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from omnilab.api import Floats

Coefficients = tuple[float, ...]  # four, five or eight
STEPS = 20
HALVINGS = 60  # of an interval, at most: to the last bit
LAST_STEP = 1e-14  # in parts of what is found: what Newton's method leaves then is far below


def radial(r2: Floats, coefficients: Coefficients) -> Floats:
    """The factor by which distortion along the radius moves points, of the square of their radius."""
    k1, k2, _, _, *more = coefficients
    factor = 1 + k1 * r2 + k2 * r2**2
    if not any(more):
        return np.asarray(factor)
    k3, k4, k5, k6 = [*more, 0.0, 0.0, 0.0][:4]
    return np.asarray((factor + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3))


def radial_slope(r2: Floats, coefficients: Coefficients) -> Floats:
    """The derivative of `radial` by the square of the radius."""
    k1, k2, _, _, *more = coefficients
    if not any(more):
        return np.asarray(k1 + 2 * k2 * r2)
    k3, k4, k5, k6 = [*more, 0.0, 0.0, 0.0][:4]
    below = 1 + k4 * r2 + k5 * r2**2 + k6 * r2**3
    above_slope = k1 + 2 * k2 * r2 + 3 * k3 * r2**2
    below_slope = k4 + 2 * k5 * r2 + 3 * k6 * r2**2
    return np.asarray((above_slope - radial(r2, coefficients) * below_slope) / below)


def turning_radius(coefficients: Coefficients) -> float:
    """The radius up to which radius x `radial` grows; infinity where it always does."""
    k1, k2, _, _, *more = coefficients
    if any(more):
        return _turning_radius_of_ratio(coefficients)
    discriminant = 9 * k1**2 - 20 * k2  # of 1 + 3 k1 radius^2 + 5 k2 radius^4
    if discriminant < 0:
        return np.inf
    inverse = (math.sqrt(discriminant) - 3 * k1) / 2  # of the smallest square
    return 1 / math.sqrt(inverse) if inverse > 1e-12 else np.inf


def _turning_radius_of_ratio(coefficients: Coefficients) -> float:
    """The root of the smallest positive square at which the derivative of radius x ratio is 0, or the ratio a pole."""
    k1, k2, _, _, *more = coefficients
    k3, k4, k5, k6 = [*more, 0.0, 0.0, 0.0][:4]
    above, below = np.poly1d([k3, k2, k1, 1]), np.poly1d([k6, k5, k4, 1])
    square = np.poly1d([1, 0])
    slope = (above + 2 * square * above.deriv()) * below - 2 * square * above * below.deriv()
    return math.sqrt(min(smallest_positive_root(slope), smallest_positive_root(below)))


def smallest_positive_root(polynomial: np.poly1d) -> float:
    """The smallest real root above 0 of a polynomial with the constant term 1; infinity where there is none."""
    inverse = np.roots(polynomial.coeffs[::-1])  # of a polynomial with the first coefficient 1, which is well posed
    real = inverse[np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)].real
    largest = float(np.max(real, initial=0.0))
    return 1 / largest if largest > 1e-12 else np.inf


def distorted(points: Floats, coefficients: Coefficients) -> Floats:
    """Points (..., 2) as the lens moves them."""
    p1, p2 = coefficients[2:4]
    x, y = np.moveaxis(points, -1, 0)
    r2 = x**2 + y**2
    aside = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y], -1)
    return np.asarray(points * radial(r2, coefficients)[..., None] + aside)


def undistorted(points: Floats, coefficients: Coefficients, start: Floats | None = None) -> Floats:
    """The inverse of `distorted`, by Newton's method; NaN where it does not converge to 1e-12.

    It starts from the points themselves, or from `start` (..., 2).
    """
    found = np.array(points if start is None else start, float)
    with np.errstate(all="ignore"):  # points that no lens moves here run off
        for _ in range(STEPS):
            error = distorted(found, coefficients) - points
            xx, xy, yy = _slopes(found, coefficients)
            step = np.stack([yy * error[..., 0] - xy * error[..., 1], xx * error[..., 1] - xy * error[..., 0]], -1)
            step = step / (xx * yy - xy**2)[..., None]
            found = found - step
            if start is not None and not (np.abs(step) > LAST_STEP).any():
                break
        good = np.abs(distorted(found, coefficients) - points).max(-1) < 1e-12
        good &= np.hypot(found[..., 0], found[..., 1]) <= turning_radius(coefficients)
    return np.where(good[..., None], found, np.nan)


def _slopes(points: Floats, coefficients: Coefficients) -> tuple[Floats, Floats, Floats]:
    """The derivatives of `distorted`: of x by x, of x by y (and y by x), of y by y."""
    p1, p2 = coefficients[2:4]
    x, y = np.moveaxis(points, -1, 0)
    r2 = x**2 + y**2
    factor, steeper = radial(r2, coefficients), 2 * radial_slope(r2, coefficients)
    xx = factor + steeper * x**2 + 2 * p1 * y + 6 * p2 * x
    xy = steeper * x * y + 2 * p1 * x + 2 * p2 * y
    yy = factor + steeper * y**2 + 6 * p1 * y + 2 * p2 * x
    return xx, xy, yy


def solve_growing(function: Callable[[Floats], tuple[Floats, Floats]], values: Floats, upper: float) -> Floats:
    """Where a function that grows from 0 at 0 up to `upper` takes values (...,); NaN where it does not.

    The function gives its value and its slope. Newton's method, halving the interval where a step would leave it.
    """
    with np.errstate(all="ignore"):
        reached = (values >= 0) & (values <= function(np.asarray(float(upper)))[0])
        wanted = np.where(reached, values, np.nan)
        low, high = np.zeros(wanted.shape), np.full(wanted.shape, float(upper))
        found = np.clip(wanted, 0, upper)
        for _ in range(HALVINGS):
            value, slope = function(found)
            low, high = np.where(value <= wanted, found, low), np.where(value >= wanted, found, high)
            step = found - (value - wanted) / slope
            better = np.where((step > low) & (step < high), step, (low + high) / 2)
            moved, found = np.abs(better - found), better
            if not (moved > LAST_STEP * found).any():  # NaN is nowhere sought
                break
    return np.asarray(np.where(reached, found, np.nan))
