"""Signatures of as many places as one likes, with the statistics of rendered ones: a smooth random field over a plane.

Each principal component of the rendered signatures is a Gaussian field of its own, with the component's variance and the
correlation that the component has at a distance, fitted by a sum of Gaussians (non-negative least squares). Fields are sums
of cosines whose frequencies are drawn from the correlations' spectra (the spectral method: Shinozuka and Deodatis, 1991;
random Fourier features: Rahimi and Recht, 2007), so that one can be evaluated at any place and at any query.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

REACHES_M = np.array([0.05, 0.1, 0.2, 0.4, 0.8, 1.6])  # of the Gaussians
LAGS_M = np.array([0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0])  # edges of the classes of pairs
WAVES = 170  # cosines for each reach
CHUNK = 20_000  # places evaluated at once


@dataclass(frozen=True)
class Field:
    """Signatures as a function of the position."""

    mean: np.ndarray  # (D,)
    frequency: np.ndarray  # (2, M) radians per metre
    phase: np.ndarray  # (M,)
    amplitude: np.ndarray  # (M, D)

    def at(self, position_m):
        """Signatures (N, D) at positions (N, 2)."""
        found = np.empty((len(position_m), len(self.mean)), np.float32)
        for start in range(0, len(found), CHUNK):
            chunk = slice(start, start + CHUNK)
            waves = np.cos((position_m[chunk] @ self.frequency).astype(np.float32) + self.phase)
            found[chunk] = self.mean + waves @ self.amplitude
        return found


def field_like(signatures, position_m, seed):
    """A field with the statistics of signatures (N, D) at positions (N, 2)."""
    mean = signatures.mean(axis=0)
    variance, axes = np.linalg.eigh(np.cov(signatures.T))
    variance = np.maximum(variance, 0)
    share = _shares((signatures - mean) @ axes, position_m)
    rng = np.random.default_rng(seed)
    frequency = rng.standard_normal((2, len(REACHES_M), WAVES)) / REACHES_M[:, None]
    weight = rng.standard_normal((len(REACHES_M), WAVES, len(mean)))
    weight *= np.sqrt(2 * share.T * variance)[:, None] / np.sqrt((weight**2).sum(axis=1, keepdims=True))
    amplitude = (weight.reshape(-1, len(mean)) @ axes.T).astype(np.float32)
    phase = rng.uniform(0, 2 * np.pi, len(amplitude)).astype(np.float32)
    return Field(mean.astype(np.float32), frequency.reshape(2, -1), phase, amplitude)


def _shares(components, position_m):
    """The share (D, reaches) of each Gaussian in the correlation of each component (N, D); rows add up to 1."""
    first, second, apart_m, lag = _pairs(position_m)
    gaussians = np.exp(-0.5 * (apart_m[:, None] / REACHES_M) ** 2)
    basis = np.stack([gaussians[lag == k].mean(axis=0) for k in range(len(LAGS_M) - 1)])
    half = (components[first] - components[second]) ** 2 / 2
    variogram = np.stack([half[lag == k].mean(axis=0) for k in range(len(LAGS_M) - 1)])
    correlation = 1 - variogram / np.maximum(components.var(axis=0), 1e-12)
    near = 1 / np.sqrt(np.maximum(1 - basis.mean(axis=1), 1e-3))[:, None]  # short distances are what search lives by
    found = np.stack([nnls(near * (1 - basis), near[:, 0] * (1 - r))[0] for r in correlation.T])
    return found / np.maximum(found.sum(axis=1, keepdims=True), 1e-12)


def mean_distances(signatures, position_m):
    """The mean cosine distance of pairs of signatures (N, D), by how far they are apart: one for each class of `LAGS_M`."""
    unit = signatures / np.linalg.norm(signatures, axis=1, keepdims=True)
    first, second, _, lag = _pairs(position_m)
    distance = 0.5 * ((unit[first] - unit[second]) ** 2).sum(axis=1)
    return np.array([distance[lag == k].mean() for k in range(len(LAGS_M) - 1)])


def _pairs(position_m, most=3000):
    """Pairs within the longest lag, at most so many of each class: two indices, distances, classes."""
    pairs = cKDTree(position_m).query_pairs(LAGS_M[-1], output_type="ndarray")
    apart_m = np.linalg.norm(position_m[pairs[:, 0]] - position_m[pairs[:, 1]], axis=1)
    lag = np.digitize(apart_m, LAGS_M[1:-1])
    kept = np.concatenate([np.flatnonzero(lag == k)[:most] for k in range(len(LAGS_M) - 1)])
    return pairs[kept, 0], pairs[kept, 1], apart_m[kept], lag[kept]
