"""Angles and rigid motions. `T_a_b` takes points of frame b to frame a."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats


def wrap_angle(angle_rad: npt.ArrayLike) -> Floats:
    """The same angles in [-pi, pi)."""
    return np.asarray(np.mod(np.asarray(angle_rad) + np.pi, 2 * np.pi) - np.pi)


def planar_poses(position_m: npt.ArrayLike, heading_rad: npt.ArrayLike = 0.0) -> Floats:
    """`T_world_camera` (N, 4, 4) of upright cameras at positions (N, 3) that are turned by headings (N,) about +z."""
    position_m = np.atleast_2d(np.asarray(position_m, float))
    heading = np.broadcast_to(np.asarray(heading_rad, float), len(position_m))
    c, s = np.cos(heading), np.sin(heading)
    T = np.tile(np.eye(4), (len(position_m), 1, 1))
    T[:, 0, 0], T[:, 0, 1] = c, -s
    T[:, 1, 0], T[:, 1, 1] = s, c
    T[:, :3, 3] = position_m
    return T


def rotation_xyz(x_rad: npt.ArrayLike, y_rad: npt.ArrayLike, z_rad: npt.ArrayLike) -> Floats:
    """Rotations (..., 3, 3) = Rx(x) Ry(y) Rz(z) from angles (...) (Berenguer, thesis, eq. 3.8-3.11)."""
    x, y, z = np.broadcast_arrays(np.asarray(x_rad, float), y_rad, z_rad)
    return np.asarray(_turn(x, 0) @ _turn(y, 1) @ _turn(z, 2))


def _turn(angle_rad: Floats, axis: int) -> Floats:
    """Rotations (..., 3, 3) about one axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((*angle_rad.shape, 3, 3))
    R[..., axis, axis] = 1
    R[..., i, i] = R[..., j, j] = np.cos(angle_rad)
    R[..., j, i] = np.sin(angle_rad)
    R[..., i, j] = -np.sin(angle_rad)
    return R


def rotation_of_quaternion(xyzw: npt.ArrayLike) -> Floats:
    """Rotations (..., 3, 3) of quaternions (..., 4), order x, y, z, w, of any length above 0."""
    q = np.asarray(xyzw, float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    v, w = q[..., :3], q[..., 3, None, None]
    zero = np.zeros(q.shape[:-1])
    cross = np.stack(
        [zero, -v[..., 2], v[..., 1], v[..., 2], zero, -v[..., 0], -v[..., 1], v[..., 0], zero], -1
    ).reshape(*q.shape[:-1], 3, 3)
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def poses(position_m: npt.ArrayLike, R_world_camera: npt.ArrayLike) -> Floats:
    """`T_world_camera` (N, 4, 4) of cameras at positions (N, 3) with rotations (N, 3, 3), or one rotation (3, 3) for all."""
    position_m = np.atleast_2d(np.asarray(position_m, float))
    T = np.tile(np.eye(4), (len(position_m), 1, 1))
    T[:, :3, :3] = R_world_camera
    T[:, :3, 3] = position_m
    return T


def heading_of(T_world_camera: Floats) -> Floats:
    """Headings (...,) of poses (..., 4, 4): the angle from the world's +x to the camera's +x about +z, in radians."""
    return np.arctan2(T_world_camera[..., 1, 0], T_world_camera[..., 0, 0])


def quaternion_xyzw(T: Floats) -> Floats:
    """Unit quaternions (..., 4), order x, y, z, w with w >= 0, of the rotations in T (..., 4, 4) or (..., 3, 3).

    Each of the four components is computed from the diagonal and the largest decides the signs (Shepperd, 1978).
    """
    R = np.asarray(T, float)[..., :3, :3]
    m00, m11, m22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    # fmt: off
    K = np.stack([
        np.stack([1 + m00 - m11 - m22, R[..., 1, 0] + R[..., 0, 1], R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] - R[..., 1, 2]], -1),
        np.stack([R[..., 1, 0] + R[..., 0, 1], 1 - m00 + m11 - m22, R[..., 2, 1] + R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0]], -1),
        np.stack([R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] + R[..., 1, 2], 1 - m00 - m11 + m22, R[..., 1, 0] - R[..., 0, 1]], -1),
        np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1], 1 + m00 + m11 + m22], -1),
    ], -2)
    # fmt: on
    # every row of K is the quaternion times 4 q_i: the row of the largest component is the best conditioned
    best = np.argmax(np.diagonal(K, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(K, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0, -q, q))


class Similarity(NamedTuple):
    """Points p become `scale` R p + t. A negative determinant of R is a reflection."""

    scale: Floats  # (...,)
    R: Floats  # (..., d, d)
    t: Floats  # (..., d)

    def apply(self, points: npt.ArrayLike) -> Floats:
        """Points (..., n, d), moved."""
        moved = self.scale[..., None, None] * np.asarray(points, float) @ np.swapaxes(self.R, -1, -2)
        return np.asarray(moved + self.t[..., None, :])


def procrustes(source: npt.ArrayLike, target: npt.ArrayLike, scale: bool = True, reflection: bool = True) -> Similarity:
    """The similarity that takes points (..., n, d), d = 2 or 3, closest to others in the least squares (Umeyama, 1991).

    Without `scale` it is 1, without `reflection` R is a rotation. Where either set lies on one line (d = 3: in one
    plane) a turn and its mirror image fit alike, see `spanned`; the turn is answered. Points that coincide keep scale 1.
    """
    x, y = np.broadcast_arrays(np.asarray(source, float), np.asarray(target, float))
    if x.ndim < 2 or x.shape[-2] == 0 or not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError(
            f"points of shapes {np.shape(source)} and {np.shape(target)} with all numbers finite are needed"
        )
    x_mean, y_mean = x.mean(axis=-2, keepdims=True), y.mean(axis=-2, keepdims=True)
    x, y = x - x_mean, y - y_mean
    U, D, Vt = np.linalg.svd(np.swapaxes(y, -1, -2) @ x)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    if reflection:
        sign = np.where(D[..., -1] > 1e-12 * D[..., 0], 1.0, sign)
    U[..., -1] *= sign[..., None]
    R = U @ Vt
    spread = (x**2).sum(axis=(-2, -1))
    factor = np.ones(spread.shape)
    if scale:
        along = D[..., :-1].sum(axis=-1) + sign * D[..., -1]
        np.divide(along, spread, out=factor, where=spread > 0)
    t = (y_mean - factor[..., None, None] * x_mean @ np.swapaxes(R, -1, -2))[..., 0, :]
    return Similarity(factor, R, t)


def spanned(points: npt.ArrayLike, tolerance: float = 1e-6) -> npt.NDArray[np.integer[Any]]:
    """How many dimensions points (..., n, d) fill: 0 if they coincide, 1 on a line, 2 in a plane.

    A direction counts where they spread by more than `tolerance` of what they do along the widest.
    """
    points = np.asarray(points, float)
    spread = np.linalg.svd(points - points.mean(axis=-2, keepdims=True), compute_uv=False)
    rounding = 1e-12 * np.abs(points).max(axis=(-2, -1))[..., None]
    return np.asarray((spread > np.maximum(tolerance * spread[..., :1], rounding)).sum(axis=-1))
