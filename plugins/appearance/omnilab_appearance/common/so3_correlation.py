"""Correlation of functions on the sphere over all rotations, by Fourier transforms on SO(3)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Floats
from omnilab_appearance.common.spherical_harmonics import (
    Complexes,
    rotated,
    wigner_d,
)


def betas_of(band_limit: int, largest_tilt_rad: float = np.pi) -> Floats:
    """The angles between the two z axes (K,) that a grid of steps pi / (2 L) has up to a largest one."""
    steps = max(1, int(np.ceil(2 * band_limit * largest_tilt_rad / np.pi - 1e-9)))
    return np.linspace(0, largest_tilt_rad, steps + 1)


def correlate(one: Complexes, others: Complexes, betas_rad: Floats) -> Floats:
    """C(R) = integral of f(R d) g(d) for rotations R = Rz(alpha) Ry(beta) Rz(gamma), (P, K, 2 L, 2 L), alpha before gamma.

    `one` (L, 2 L - 1) are the complex coefficients of f, `others` (P, L, 2 L - 1) those of P functions g. By the shift
    theorem C(R) = sum of conj(f_lm) D^l_mm'(R) g_lm' (Makadia and Daniilidis, 2006, eq. 13; Kostelec and Rockmore, 2008):
    a sum over degrees for each beta, and a Fourier transform over both other angles, on 2 L samples of each.
    """
    from scipy import fft

    limit = one.shape[0]
    d = _wigner_table(limit, tuple(betas_rad.tolist()))  # (K, L, M, M)
    left = one[:, limit - 1 :].conj()  # m >= 0: C is real
    spectra = np.zeros((len(others), len(betas_rad), limit, 2 * limit), complex)
    product = np.einsum(
        "klmn,lm,pln->pkmn", d[:, :, limit - 1 :], left, others, optimize=["einsum_path", (0, 1), (0, 1)]
    )
    spectra[..., :limit] = product[..., limit - 1 :]
    spectra[..., limit + 1 :] = product[..., : limit - 1]
    # kernels are exp(-i m alpha), exp(-i m' gamma): the forward transform over m', the conjugate inverse over m >= 0
    over_gamma = fft.fft(spectra, axis=-1)
    return np.asarray(fft.irfft(over_gamma.conj(), 2 * limit, axis=-2) * (2 * limit))


@lru_cache(maxsize=4)
def _wigner_table(limit: int, betas_rad: tuple[float, ...]) -> Floats:
    """d^l_mm'(beta) (K, L, 2 L - 1, 2 L - 1), 0 where an order is above the degree."""
    table = np.zeros((len(betas_rad), limit, 2 * limit - 1, 2 * limit - 1))
    for l in range(limit):
        own = slice(limit - 1 - l, limit + l)
        table[:, l, own, own] = wigner_d(l, np.array(betas_rad))
    return table


def at_rotations(one: Complexes, other: Complexes, R: Floats) -> Floats:
    """C(R) (n, ...) of functions whose complex coefficients are (..., L, 2 L - 1), at rotations R (n, 3, 3)."""
    turned = rotated(np.broadcast_to(other, (len(R), *other.shape)), R)
    return np.asarray((one.conj() * turned).real.sum(axis=(-2, -1)))
