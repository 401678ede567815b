"""Compiled loops over matched directions, for motions in the plane.

A camera moves by an unknown length towards beta and turns by phi; gamma = beta - phi is where it came towards, as seen
in its new frame. Directions p before and q after that show one point fulfil
p_z (q_y cos gamma - q_x sin gamma) + q_z (p_x sin beta - p_y cos beta) = 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from omnilab.api import Floats, Ints

SURE = 1e-3  # probability that all draws held a wrong match, at which drawing ends


@njit(cache=True)  # type: ignore[untyped-decorator]
def squared_angle(p: Floats, q: Floats, i: int, cg: float, sg: float, cb: float, sb: float) -> float:
    """Squared distance of match i from the epipolar constraint, in radians (Sampson, 1982, on the sphere)."""
    a = q[i, 1] * cg - q[i, 0] * sg
    b = p[i, 0] * sb - p[i, 1] * cb
    r = p[i, 2] * a + q[i, 2] * b
    steep = q[i, 2] ** 2 + a * a + p[i, 2] ** 2 + b * b - 2 * r * r
    return r * r / steep if steep > 1e-12 else 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def cost(p: Floats, q: Floats, phi: float, beta: float, cut: float, best: float) -> tuple[float, int]:
    """Sum of squared angles, each at most `cut`, given up beyond `best`; and how many are below."""
    cg, sg, cb, sb = math.cos(beta - phi), math.sin(beta - phi), math.cos(beta), math.sin(beta)
    total, below = 0.0, 0
    for i in range(len(p)):
        e = squared_angle(p, q, i, cg, sg, cb, sb)
        if e < cut:
            total += e
            below += 1
        else:
            total += cut
        if total >= best:
            return total, below
    return total, below


@njit(cache=True)  # type: ignore[untyped-decorator]
def two_point(p: Floats, q: Floats, i: int, j: int, found: Floats) -> int:
    """Motions (phi, beta), up to two rows of `found`, that two matches fulfil: how many.

    The constraint is A u + C v = 0 with u = (cos gamma, sin gamma), v = (cos beta, sin beta); u = M v has length 1.
    """
    a00, a01, a10, a11 = p[i, 2] * q[i, 1], -p[i, 2] * q[i, 0], p[j, 2] * q[j, 1], -p[j, 2] * q[j, 0]
    c00, c01, c10, c11 = -q[i, 2] * p[i, 1], q[i, 2] * p[i, 0], -q[j, 2] * p[j, 1], q[j, 2] * p[j, 0]
    det = a00 * a11 - a01 * a10
    if abs(det) < 1e-9:
        return 0
    m00, m01 = -(a11 * c00 - a01 * c10) / det, -(a11 * c01 - a01 * c11) / det
    m10, m11 = -(a00 * c10 - a10 * c00) / det, -(a00 * c11 - a10 * c01) / det
    xx, xy, yy = m00 * m00 + m10 * m10 - 1, m00 * m01 + m10 * m11, m01 * m01 + m11 * m11 - 1
    half, size = (xx - yy) / 2, math.hypot((xx - yy) / 2, xy)  # (xx + yy) / 2 + size cos(2 beta - middle) = 0
    if size < 1e-12 or abs(xx + yy) > 2 * size:
        return 0
    middle, off = math.atan2(xy, half), math.acos(-(xx + yy) / (2 * size))
    for k in range(2):
        beta = (middle + (off if k == 0 else -off)) / 2
        cb, sb = math.cos(beta), math.sin(beta)
        found[k, 1] = beta
        found[k, 0] = beta - math.atan2(m10 * cb + m11 * sb, m00 * cb + m01 * sb)
    return 2


@njit(cache=True)  # type: ignore[untyped-decorator]
def best_of_pairs(p: Floats, q: Floats, picks: Ints, cut: float) -> tuple[float, float, float]:
    """The motion (phi, beta) of the least cost among those that drawn pairs (D, 2) of matches fulfil; and the cost."""
    found = np.empty((2, 2))
    best, phi, beta = math.inf, 0.0, 0.0
    needed = float(len(picks))
    for draw in range(len(picks)):
        if draw >= needed:
            break
        i, j = picks[draw]
        for k in range(two_point(p, q, i, j, found) if i != j else 0):
            total, below = cost(p, q, found[k, 0], found[k, 1], cut, best)
            if total < best:
                best, phi, beta = total, found[k, 0], found[k, 1]
                share = below / len(p)
                if share >= 1:
                    needed = 0
                elif share > 0:
                    needed = math.log(SURE) / math.log(1 - share * share)
    return phi, beta, best


@njit(cache=True)  # type: ignore[untyped-decorator]
def refined(p: Floats, q: Floats, phi: float, beta: float, width: float) -> tuple[float, float, float, Floats]:
    """The motion (phi, beta) that fits best by Cauchy's loss of a width in squared radians, from a first guess.

    By reweighted Gauss-Newton. Also the standard deviation of a direction, were all errors normal, and the covariance
    (2, 2) of an M-estimator (Huber, 1964): matches that are off count little, and widen it.
    """
    covariance = np.full((2, 2), np.inf)
    sigma = math.sqrt(width)
    for _ in range(15):
        cg, sg, cb, sb = math.cos(beta - phi), math.sin(beta - phi), math.cos(beta), math.sin(beta)
        h00, h01, h11, g0, g1 = 0.0, 0.0, 0.0, 0.0, 0.0
        psi_squares, slopes, j00, j01, j11, count = 0.0, 0.0, 0.0, 0.0, 0.0, 0
        for i in range(len(p)):
            a = q[i, 1] * cg - q[i, 0] * sg
            b = p[i, 0] * sb - p[i, 1] * cb
            r = p[i, 2] * a + q[i, 2] * b
            steep = q[i, 2] ** 2 + a * a + p[i, 2] ** 2 + b * b - 2 * r * r
            if steep < 1e-12 or r * r > 25 * width * steep:
                continue
            e = r * r / steep
            weight = 1 / (1 + e / width)
            d0 = p[i, 2] * (q[i, 1] * sg + q[i, 0] * cg)  # dr / dphi
            d1 = q[i, 2] * (p[i, 0] * cb + p[i, 1] * sb) - d0  # dr / dbeta: gamma changes, too
            h00 += weight * d0 * d0 / steep
            h01 += weight * d0 * d1 / steep
            h11 += weight * d1 * d1 / steep
            g0 += weight * d0 * r / steep
            g1 += weight * d1 * r / steep
            j00 += d0 * d0 / steep
            j01 += d0 * d1 / steep
            j11 += d1 * d1 / steep
            psi_squares += weight * weight * e
            slopes += (1 - e / width) * weight * weight
            count += 1
        det, square = h00 * h11 - h01 * h01, j00 * j11 - j01 * j01
        if count < 4 or slopes <= 0 or det <= 1e-14 * (h00 + h11) ** 2 or square <= 1e-14 * (j00 + j11) ** 2:
            return phi, beta, sigma, np.full((2, 2), np.inf)
        spread = (psi_squares / (count - 2)) / (slopes / count) ** 2
        sigma = math.sqrt(spread)
        covariance[0, 0], covariance[1, 1] = spread * j11 / square, spread * j00 / square
        covariance[0, 1] = covariance[1, 0] = -spread * j01 / square
        step0, step1 = (h11 * g0 - h01 * g1) / det, (h00 * g1 - h01 * g0) / det
        phi -= step0
        beta -= step1
        if abs(step0) + abs(step1) < 1e-9:
            break
    return phi, beta, sigma, covariance


@njit(cache=True)  # type: ignore[untyped-decorator]
def parallax(p: Floats, q: Floats, phi: float, beta: float, cut: float) -> tuple[float, float]:
    """Above 0 if the matches within `cut` lie before the camera that moved towards beta; and their mean squared parallax."""
    cg, sg, cb, sb = math.cos(beta - phi), math.sin(beta - phi), math.cos(beta), math.sin(beta)
    cp, sp = math.cos(phi), math.sin(phi)
    votes, squares, count = 0.0, 0.0, 0
    for i in range(len(p)):
        if squared_angle(p, q, i, cg, sg, cb, sb) >= cut:
            continue
        rx, ry, rz = cp * q[i, 0] - sp * q[i, 1], sp * q[i, 0] + cp * q[i, 1], q[i, 2]
        px, py, pz = p[i, 0], p[i, 1], p[i, 2]
        nx, ny, nz = py * rz - pz * ry, pz * rx - px * rz, px * ry - py * rx  # p x Rq
        # t x (Rq + p), t = (cos beta, sin beta, 0): positive with p x Rq where depths are
        sx, sy, sz = rx + px, ry + py, rz + pz
        votes += nx * (sb * sz) + ny * (-cb * sz) + nz * (cb * sy - sb * sx)
        squares += nx * nx + ny * ny + nz * nz
        count += 1
    return votes, squares / max(count, 1)
