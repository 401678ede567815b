"""A start for the least squares: a radially symmetric camera around a guessed centre, and the poses of the boards by it.

The radius in the picture is tried as f t (equidistant lenses) and 2 f tan(t / 2) (mirrors, stereographic lenses) of
the angle t to the axis, over a range of f. For each, every board's pose is linear in its corners' rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.calibration.board import Corners
from omnilab.cameras.calibration.models import half_diagonal
from omnilab.cameras.lenses import AxialCamera, FisheyeCamera, UnifiedCamera

ANGLES_DEG = np.arange(25.0, 150.0, 2.5)  # at half the diagonal, of the cameras that are tried


@dataclass(frozen=True)
class RadialStart:
    """The best of the cameras that were tried, and poses (B, 3, 3), (B, 3) of the boards."""

    camera: AxialCamera
    R: Floats
    t: Floats
    error_rad: Floats  # (B) between the rays of the corners and the boards


def radial_start(corners: Corners) -> RadialStart:
    """The camera of which half the boards fit best."""
    starts = (_posed(camera, corners) for camera in _cameras(corners.width, corners.height))
    return min(starts, key=lambda start: float(np.median(start.error_rad)))


def _cameras(width: int, height: int) -> list[AxialCamera]:
    radius = half_diagonal(width, height)
    frame = {"width": width, "height": height, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    angle = np.deg2rad(ANGLES_DEG)
    lenses = [FisheyeCamera(**frame, focal_px=f) for f in radius / angle]  # type: ignore[arg-type]
    mirrors = [UnifiedCamera(**frame, fx=f, fy=f, xi=1.0) for f in radius / np.tan(angle / 2)]  # type: ignore[arg-type]
    return [*lenses, *mirrors]


def _posed(camera: AxialCamera, corners: Corners) -> RadialStart:
    rays = camera.rays(corners.pixels)
    R, t = linear_poses(rays, corners.board.points)
    shown = corners.board.points @ np.swapaxes(R, 1, 2) + t[:, None]
    shown /= np.linalg.norm(shown, axis=-1, keepdims=True)
    return RadialStart(camera, R, t, np.sqrt(np.nanmean(((shown - rays) ** 2).sum(-1), 1)))


def linear_poses(rays: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Rotations (B, 3, 3) and translations (B, 3) of boards whose points (n, 3), z = 0, are seen along rays (B, n, 3).

    ray x (h1 X + h2 Y + h3) = 0 is linear in H = [h1 h2 h3], which is [r1 r2 t] up to scale. It holds for rays of any
    angle to the axis, where a homography in the picture does not. NaN rays do not count.
    """
    plane = points[:, [0, 1]] - (middle := points[:, :2].mean(0))
    plane = np.column_stack([plane, np.ones(len(points))])
    x, y, z = np.moveaxis(np.nan_to_num(rays), -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*x.shape, 3, 3)
    A = np.einsum("bnij,nk->bnijk", cross, plane).reshape(len(x), -1, 9)
    H = np.linalg.svd(A, full_matrices=False)[2][:, -1].reshape(-1, 3, 3)
    ahead = np.einsum("bnj,bjk,nk->b", np.nan_to_num(rays), H, plane)
    H *= np.sign(ahead)[:, None, None]
    H /= np.linalg.norm(H[:, :, :2], axis=1).mean(-1)[:, None, None]
    U, _, Vt = np.linalg.svd(np.stack([H[..., 0], H[..., 1], np.cross(H[..., 0], H[..., 1])], -1))
    R = U @ Vt
    return R, H[..., 2] - R[..., :2] @ middle
