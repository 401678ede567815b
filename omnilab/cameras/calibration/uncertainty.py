"""How well boards determine a camera: the covariance of its settings, and what that means in the picture."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.calibration.bundle import Fit
from omnilab.cameras.calibration.models import RAYS, half_diagonal, image_points, sample_rays

STEP = 1e-6


def covariance(fit: Fit) -> Floats:
    """Of the camera's free settings (k, k), in its own units, for errors that are independent and alike.

    The inverse of the normal matrix of camera and poses, times the errors' variance; infinite where it has none.
    """
    return _of_values(fit) * np.outer(*2 * [fit.model.scales(half_diagonal(fit.camera.width, fit.camera.height))])


def picture_uncertainty_px(fit: Fit, angles_rad: Floats) -> Floats:
    """Standard deviation in pixels, along either axis, of where rays at angles (m) to the axis appear, the worst around it.

    What a rotation of the camera against the boards would explain does not count: no board fixes the camera's frame.
    """
    rays = sample_rays(float(angles_rad.max()))
    shown, turned = _by_values(fit, rays), _by_turns(fit, rays)
    good = np.isfinite(shown).all((1, 2)) & np.isfinite(turned).all((1, 2))
    S, turns = shown[good].reshape(-1, shown.shape[-1]), turned[good].reshape(-1, 3)
    S -= turns @ np.linalg.lstsq(turns, S, rcond=None)[0]
    deviation = np.full((len(rays), 2), np.inf)
    deviation[good] = np.sqrt(np.einsum("nk,kl,nl->n", S, _of_values(fit), S)).reshape(-1, 2)
    worst = deviation.max(1).reshape(RAYS).max(1)
    return np.asarray(np.interp(angles_rad, np.linspace(0, float(angles_rad.max()), RAYS[0] + 1)[1:], worst))


def _of_values(fit: Fit) -> Floats:
    J, k = fit.jacobian, len(fit.values)
    size = np.linalg.norm(J, axis=0)
    if (size == 0).any():
        return np.full((k, k), np.inf)
    freedom = max(1, J.shape[0] - J.shape[1])
    variance = np.nansum(fit.errors_px**2) / freedom
    R = np.linalg.qr(J / size, mode="r")
    if np.abs(np.diag(R)).min() < 1e-12:
        return np.full((k, k), np.inf)
    inverse = np.linalg.inv(R)
    return np.asarray(variance * (inverse @ inverse.T)[:k, :k] / np.outer(size[:k], size[:k]))


def _by_values(fit: Fit, rays: Floats) -> Floats:
    """How far (n, 2, k) rays move in the picture as values of the camera change."""
    size = fit.camera.width, fit.camera.height

    def at(i: int, step: float) -> Floats:
        values = fit.values.copy()
        values[i] += step
        return image_points(fit.model, values, size, rays)

    return np.stack([(at(i, STEP) - at(i, -STEP)) / (2 * STEP) for i in range(len(fit.values))], -1)


def _by_turns(fit: Fit, rays: Floats) -> Floats:
    """How far (n, 2, 3) rays move in the picture as they turn about each axis."""
    moves = [np.cross(axis, rays) * STEP for axis in np.eye(3)]
    shown = fit.camera.image_points
    return np.stack([(shown(rays + move) - shown(rays - move)) / (2 * STEP) for move in moves], -1)
