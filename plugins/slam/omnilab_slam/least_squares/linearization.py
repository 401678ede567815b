"""Errors of a graph's edges at given poses, with their gradient and Hessian (Gauss-Newton's, J^T W J).

A pose changes by a translation in the world and a rotation (vector) in its own frame.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import inverse, matrices, residuals, vectors


class Linearization(Protocol):
    """Errors of the edges at poses (N, k)."""

    chi2: Floats  # (E,)

    def gradient(self, weights: Floats) -> Floats:
        """Half the gradient of each edge's weighted chi2 (E, 2, d), by its first and its second pose."""

    def hessian(self, weights: Floats) -> Floats:
        """The same of the second order (E, 2, 2, d, d): symmetric, without second derivatives of the error."""

    def moved(self, step: Floats) -> Floats:
        """Poses (N, k) of which all but the first have moved by steps (N - 1, d)."""


def linearized(graph: PoseGraph, poses: Floats) -> Linearization:
    """The graph's errors at poses (N, k)."""
    return Planar(graph, poses) if graph.planar else Spatial(graph, poses)


class Planar:
    """In closed form. A measured pose is (R_a, p_j) in the world, a = heading_i + turn; with M = diag(R_a, 1) the Jacobians of the error are
    M^T by the second pose and -M^T K by the first, K = [1 0 -y; 0 1 x; 0 0 1] with (x, y) = p_j - p_i."""

    def __init__(self, graph: PoseGraph, poses: Floats) -> None:
        self._graph, self._poses = graph, poses
        self._errors = residuals(graph, poses)
        self._forces = np.einsum("eij,ej->ei", graph.information, self._errors)  # W e
        self.chi2 = np.asarray(np.einsum("ei,ei->e", self._errors, self._forces))

    @cached_property
    def _between(self) -> tuple[Floats, Floats, Floats, Floats]:
        """x, y, cos a, sin a."""
        i, j = self._graph.edges.T
        x, y = (self._poses[j, :2] - self._poses[i, :2]).T
        a = self._poses[i, 2] + self._graph.motions[:, 2]
        return x, y, np.cos(a), np.sin(a)

    def gradient(self, weights: Floats) -> Floats:
        x, y, c, s = self._between
        u, v, w = weights * self._forces.T
        out = np.empty((len(x), 2, 3))
        out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = c * u - s * v, s * u + c * v, w
        out[:, 0] = -out[:, 1]
        out[:, 0, 2] += y * out[:, 1, 0] - x * out[:, 1, 1]
        return out

    def hessian(self, weights: Floats) -> Floats:
        x, y, c, s = self._between
        W = self._graph.information
        mean, half, xy = (W[:, 0, 0] + W[:, 1, 1]) / 2, (W[:, 0, 0] - W[:, 1, 1]) / 2, W[:, 0, 1]
        c2, s2 = (c - s) * (c + s), 2 * s * c
        along, across = c2 * half - s2 * xy, s2 * half + c2 * xy
        A = np.empty((3, 3, len(x)))  # M W M^T
        A[0, 0], A[1, 1], A[0, 1], A[2, 2] = mean + along, mean - along, across, W[:, 2, 2]
        A[0, 2], A[1, 2] = c * W[:, 0, 2] - s * W[:, 1, 2], s * W[:, 0, 2] + c * W[:, 1, 2]
        A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
        A *= weights
        turned = A[:, 2] - y * A[:, 0] + x * A[:, 1]  # the last column of A K
        out = np.empty((len(x), 2, 2, 3, 3))
        out[:, 1, 1] = A.transpose(2, 0, 1)
        out[:, 1, 0] = -out[:, 1, 1]
        out[:, 1, 0, :, 2] = -turned.T
        out[:, 0, 1] = np.swapaxes(out[:, 1, 0], 1, 2)
        out[:, 0, 0] = out[:, 1, 1]
        out[:, 0, 0, :2, 2] = out[:, 0, 0, 2, :2] = turned[:2].T
        out[:, 0, 0, 2, 2] = turned[2] - y * turned[0] + x * turned[1]
        return out

    def moved(self, step: Floats) -> Floats:
        poses = self._poses.copy()
        poses[1:] += step
        poses[1:, 2] = wrap_angle(poses[1:, 2])
        return poses


class Spatial:
    """By matrices of the Jacobians."""

    def __init__(self, graph: PoseGraph, poses: Floats) -> None:
        self._graph, self._T = graph, matrices(poses)
        self._errors = residuals(graph, poses)
        self.chi2 = np.asarray(np.einsum("ei,eij,ej->e", self._errors, graph.information, self._errors))

    @cached_property
    def _jacobians(self) -> Floats:
        return jacobians(self._graph, self._T, self._errors)

    def gradient(self, weights: Floats) -> Floats:
        forces = weights[:, None, None] * (self._graph.information @ self._errors[:, :, None])
        return np.asarray((np.swapaxes(self._jacobians, -1, -2) @ forces[:, None])[..., 0])

    def hessian(self, weights: Floats) -> Floats:
        J = self._jacobians
        WJ = (weights[:, None, None] * self._graph.information)[:, None] @ J
        return np.asarray(np.swapaxes(J[:, :, None], -1, -2) @ WJ[:, None])

    def moved(self, step: Floats) -> Floats:
        T = self._T.copy()
        T[1:, :3, 3] += step[:, :3]
        T[1:, :3, :3] @= _exponential(step[:, 3:])
        return vectors(T, planar=False)


def jacobians(graph: PoseGraph, T: Floats, errors: Floats) -> Floats:
    """Jacobians (E, 2, 6, 6) of the errors (E, 6) at transforms (N, 4, 4), by the first and the second pose of their edges."""
    Ti, Tj, R_z = T[graph.edges[:, 0]], T[graph.edges[:, 1]], matrices(graph.motions)[:, :3, :3]
    R_i, R_j = Ti[:, :3, :3], Tj[:, :3, :3]
    to_z = np.swapaxes(R_i @ R_z, -1, -2)
    inwards = inverse(Ti)[:, :3, :3] @ (Tj - Ti)[:, :3, 3, None]
    right = _right_jacobian_inverse(errors[:, 3:])
    J = np.zeros((len(Ti), 2, 6, 6))
    J[:, 0, :3, :3], J[:, 1, :3, :3] = -to_z, to_z
    J[:, 0, :3, 3:] = np.swapaxes(R_z, -1, -2) @ _skew(inwards[..., 0])
    J[:, 0, 3:, 3:] = -right @ np.swapaxes(R_j, -1, -2) @ R_i
    J[:, 1, 3:, 3:] = right
    return J


def _skew(v: Floats) -> Floats:
    """Skew-symmetric matrices (N, 3, 3) of v (N, 3): they multiply as v does in a cross product."""
    out = np.zeros((len(v), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = v.T
    return out - np.swapaxes(out, -1, -2)


def _exponential(rotation: Floats) -> Floats:
    """Exponential map: rotations (N, 3, 3) of rotation vectors (N, 3) (Rodrigues)."""
    angle = np.linalg.norm(rotation, axis=1)[:, None, None]
    K = _skew(rotation)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * K @ K)


def _right_jacobian_inverse(rotation: Floats) -> Floats:
    """Inverse right Jacobian (N, 3, 3) of SO(3) at rotation vectors (N, 3)."""
    angle = np.linalg.norm(rotation, axis=1)[:, None, None]
    safe = np.where(angle > 1e-4, angle, 1.0)
    factor = np.where(angle > 1e-4, (1 - safe / 2 / np.tan(safe / 2)) / safe**2, 1 / 12)
    K = _skew(rotation)
    return np.asarray(np.eye(3) + K / 2 + factor * K @ K)
