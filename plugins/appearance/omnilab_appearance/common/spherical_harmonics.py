"""Spherical harmonics of functions on the unit sphere, and how rotations act on them.

A function of band limit L is Y: sum over degrees l < L and orders |m| <= l of f_lm Y_lm, with the orthonormal complex
harmonics of `scipy.special.sph_harm_y` (Condon and Shortley's phase). Real functions are held as `L^2` real numbers, those
of the orthonormal real harmonics: degree after degree, orders from -l to l.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints

Complexes = npt.NDArray[np.complexfloating[Any, Any]]


def analysis(functions: Floats, band_limit: int) -> Floats:
    """Real coefficients (..., L^2) of functions (..., H, W) sampled on a sphere; exact where their band limit is H / 2.

    Row i is at polar angle pi (i + 1/2) / H, column j at azimuth 2 pi j / W, as in an equirectangular picture whose column 0
    looks to +x, counter-clockwise. A Fourier transform by rows, then the quadrature of Driscoll and Healy (1994, theorem 3)
    at midpoints (Kostelec and Rockmore, 2008, eq. 11).
    """
    from scipy import fft

    rows, columns = functions.shape[-2:]
    spectra = fft.rfft(functions)[..., :band_limit] * (2 * np.pi / columns)  # (..., H, m)
    legendre = _legendre(band_limit, rows) * _weights(rows)[:, None]  # (m, H, l)
    orders = np.moveaxis(spectra, -1, 0)  # (m, ..., H)
    found = np.moveaxis(np.stack([o @ p for o, p in zip(orders, legendre, strict=True)]), 0, -1)  # (..., l, m)
    return packed(found)


def synthesis(coefficients: Floats, rows: int, columns: int) -> Floats:
    """The inverse of `analysis`: functions (..., H, W) of real coefficients (..., L^2)."""
    from scipy import fft

    unpacked = unpacked_of(coefficients)  # (..., l, m)
    limit = unpacked.shape[-2]
    half = np.moveaxis(unpacked[..., limit - 1 :], -1, 0)  # m >= 0 first
    spectra = np.stack([h @ p.T for h, p in zip(half, _legendre(limit, rows), strict=True)], -1)  # (..., H, m)
    return np.asarray(fft.irfft(spectra * columns, columns))


def band_limit_of(coefficients: Floats) -> int:
    """L of coefficients (..., L^2)."""
    return int(np.sqrt(coefficients.shape[-1]) + 0.5)


def degrees(band_limit: int) -> Ints:
    """The degree l of each of L^2 coefficients."""
    return np.repeat(np.arange(band_limit), 2 * np.arange(band_limit) + 1)


def power(coefficients: Floats) -> Floats:
    """The power spectrum (..., L): the sum of squares of each degree, which no rotation changes (Kazhdan et al., 2003)."""
    limit = band_limit_of(coefficients)
    return np.asarray(np.add.reduceat(coefficients**2, np.arange(limit) ** 2, axis=-1))


def unpacked_of(coefficients: Floats) -> Complexes:
    """Complex coefficients (..., L, 2 L - 1) of real ones (..., L^2): by degree, and order from 1 - L to L - 1; else 0."""
    limit = band_limit_of(coefficients)
    real = np.zeros((*coefficients.shape[:-1], limit, 2 * limit - 1))
    l, m = _indices(limit)
    real[..., l, m + limit - 1] = coefficients
    positive, negative = real[..., limit:], real[..., limit - 2 :: -1]  # of orders 1, 2, ...
    out = np.zeros(real.shape, complex)
    out[..., limit - 1] = real[..., limit - 1]
    out[..., limit:] = (positive - 1j * negative) / np.sqrt(2)
    sign = (-1.0) ** np.arange(1, limit)
    out[..., limit - 2 :: -1] = sign * out[..., limit:].conj()
    return out


def packed(half: Complexes) -> Floats:
    """Real coefficients (..., L^2) of complex ones (..., L, L) of orders m >= 0: the inverse of `unpacked_of`."""
    limit = half.shape[-1]
    l, m = _indices(limit)
    own = half[..., l, np.abs(m)]
    return np.asarray(np.where(m == 0, own.real, np.sqrt(2) * np.where(m > 0, own.real, -own.imag)))


def _indices(band_limit: int) -> tuple[Ints, Ints]:
    l = degrees(band_limit)
    return l, np.arange(band_limit**2) - l**2 - l


@lru_cache(maxsize=8)
def _legendre(band_limit: int, rows: int) -> Floats:
    """Y_lm at azimuth 0 for orders m >= 0: (m, H, l)."""
    from scipy.special import sph_harm_y

    theta = np.pi * (np.arange(rows) + 0.5) / rows
    l, m = np.arange(band_limit), np.arange(band_limit)[:, None, None]
    return np.asarray(np.where(l >= m, sph_harm_y(np.maximum(l, m), m, theta[:, None], 0.0).real, 0.0))


@lru_cache(maxsize=8)
def _weights(rows: int) -> Floats:
    """Weights (H,) with which sums over rows at pi (i + 1/2) / H are integrals of polynomials in cos of degree below H.

    Fejer's first rule, which is what Driscoll and Healy's weights become at midpoints; they sum to 2.
    """
    i, k = np.arange(rows), np.arange(1, rows // 2 + 1)
    theta = np.pi * (i + 0.5) / rows
    return np.asarray(2 / rows * (1 - 2 * (np.cos(2 * np.outer(theta, k)) / (4 * k**2 - 1)).sum(axis=1)))


# ------------------------------------------------------------------------------------------------------- rotations
@lru_cache(maxsize=64)
def _eigenvectors(degree: int) -> Complexes:
    """Eigenvectors (2 l + 1, 2 l + 1) of the angular momentum J_y for eigenvalues -l to l, rows by order m."""
    m = np.arange(-degree, degree)
    raising = np.diag(np.sqrt(degree * (degree + 1) - m * (m + 1)), -1)  # J_+: m to m + 1
    return np.asarray(np.linalg.eigh((raising - raising.T) / 2j)[1])


def wigner_d(degree: int, beta_rad: Floats) -> Floats:
    """Wigner's d^l_{mm'}(beta) (..., 2 l + 1, 2 l + 1) of angles (...), orders from -l to l.

    By diagonalising J_y, d = exp(-i beta J_y), which is exact to rounding at every degree where recurrences lose digits
    (Feng, Wang, Yang and Jin, 2015).
    """
    X = _eigenvectors(degree)
    phase = np.exp(-1j * np.asarray(beta_rad)[..., None] * np.arange(-degree, degree + 1))
    return np.asarray(np.einsum("mn,...n,kn->...mk", X, phase, X.conj()).real)


def rotated(coefficients: Complexes, R: Floats) -> Complexes:
    """Complex coefficients (n, ..., L, 2 L - 1) of n functions d -> f(R^T d), for rotations R (n, 3, 3)."""
    limit = coefficients.shape[-2]
    alpha, beta, gamma = (angle.reshape(-1, *([1] * (coefficients.ndim - 2))) for angle in zyz_of(R))
    m = np.arange(1 - limit, limit)
    turned = coefficients * np.exp(-1j * gamma * m)[..., None, :]
    out = np.zeros_like(turned)
    for l in range(limit):
        own = slice(limit - 1 - l, limit + l)
        d = wigner_d(l, beta[..., 0] if beta.ndim > 1 else beta)
        out[..., l, own] = (d @ turned[..., l, own, None])[..., 0]
    return np.asarray(out * np.exp(-1j * alpha * m)[..., None, :])


def zyz_of(R: Floats) -> tuple[Floats, Floats, Floats]:
    """Angles alpha, beta, gamma (...) of rotations R = Rz(alpha) Ry(beta) Rz(gamma), (..., 3, 3), beta in [0, pi]."""
    beta = np.arctan2(np.hypot(R[..., 0, 2], R[..., 1, 2]), R[..., 2, 2])
    upright = np.hypot(R[..., 0, 2], R[..., 1, 2]) < 1e-12  # only alpha + gamma, or alpha - gamma, is known
    alpha = np.where(upright, 0.0, np.arctan2(R[..., 1, 2], R[..., 0, 2]))
    gamma = np.where(upright, np.arctan2(R[..., 1, 0], R[..., 1, 1]), np.arctan2(R[..., 2, 1], -R[..., 2, 0]))
    return alpha, beta, gamma


def rotation_zyz(alpha: Floats, beta: Floats, gamma: Floats) -> Floats:
    """Rotations (..., 3, 3) = Rz(alpha) Ry(beta) Rz(gamma)."""
    from omnilab.geometry import rotation_xyz

    return np.asarray(rotation_xyz(0.0, 0.0, alpha) @ rotation_xyz(0.0, beta, gamma))
