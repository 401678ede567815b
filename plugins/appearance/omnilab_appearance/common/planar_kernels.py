"""Numba kernels of planar epipolar geometry; all sums run in one fixed order.

The second camera stands at (cos beta, sin beta) times the step, rotated by phi; g = beta - phi. A match of directions p
and q keeps r = p_z (q_y cos g - q_x sin g) + q_z (p_x sin beta - p_y cos beta) = 0, which is p' E q = 0 with
e31 = -sin g, e32 = cos g, e13 = sin beta, e23 = -cos beta.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def squared_error(p, q, cg, sg, cb, sb):  # type: ignore[no-untyped-def]
    """Squared Sampson error of a match, in rad^2: both directions are of length 1."""
    a = q[1] * cg - q[0] * sg
    b = p[0] * sb - p[1] * cb
    r = p[2] * a + q[2] * b
    return r * r / (a * a + b * b + p[2] * p[2] + q[2] * q[2] - 2 * r * r + 1e-12)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cost(p, q, g, beta, limit):  # type: ignore[no-untyped-def]
    """MSAC cost, the sum of squared errors truncated at `limit`, and the count of inliers (Torr and Zisserman, 2000)."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    total, good = 0.0, 0
    for i in range(len(p)):
        e = squared_error(p[i], q[i], cg, sg, cb, sb)
        total += min(e, limit)
        good += e < limit
    return total, good


@nb.njit(cache=True, nogil=True, error_model="numpy")
def normal_equations(p, q, g, beta, limit):  # type: ignore[no-untyped-def]
    """J'J (three numbers), J'e (two), e'e and count over the matches whose squared error is below `limit`; unknowns g, beta."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    h00, h01, h11, b0, b1, ee, count = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for i in range(len(p)):
        px, py, pz = p[i, 0], p[i, 1], p[i, 2]
        qx, qy, qz = q[i, 0], q[i, 1], q[i, 2]
        a, b = qy * cg - qx * sg, px * sb - py * cb
        r = pz * a + qz * b
        n = a * a + b * b + pz * pz + qz * qz - 2 * r * r + 1e-12
        if r * r >= limit * n:
            continue
        da, db = -(qy * sg + qx * cg), px * cb + py * sb
        root = 1 / math.sqrt(n)
        e = r * root
        j0 = root * (pz * da - r * (a * da - 2 * r * pz * da) / n)
        j1 = root * (qz * db - r * (b * db - 2 * r * qz * db) / n)
        h00 += j0 * j0
        h01 += j0 * j1
        h11 += j1 * j1
        b0 += j0 * e
        b1 += j1 * e
        ee += e * e
        count += 1
    return h00, h01, h11, b0, b1, ee, count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refined(p, q, g, beta, limit, steps):  # type: ignore[no-untyped-def]
    """Gauss-Newton on both unknowns over the matches within `limit`, reselected in each step."""
    for _ in range(steps):
        h00, h01, h11, b0, b1, _ee, _count = normal_equations(p, q, g, beta, limit)
        damped = 1e-9 * (h00 + h11) + 1e-15
        h00 += damped
        h11 += damped
        det = h00 * h11 - h01 * h01
        dg, dbeta = -(h11 * b0 - h01 * b1) / det, -(h00 * b1 - h01 * b0) / det
        longest = max(abs(dg), abs(dbeta))
        shorter = min(1.0, 0.3 / (longest + 1e-300))  # where the direction is hardly seen, a step may lead anywhere
        g += shorter * dg
        beta += shorter * dbeta
        if longest < 1e-8:
            break
    return g, beta


@nb.njit(cache=True, nogil=True, error_model="numpy")
def two_points(p, q, i, j, out):  # type: ignore[no-untyped-def]
    """Two-point solver: motions (g, beta), up to half a turn of both angles, written to `out` (2, 2); their count, 0 or 2.

    Both rows say A u + C v = 0 of u = (cos g, sin g) and v = (cos beta, sin beta): u = M v, and |u| = |v| = 1.
    """
    a00, a01 = p[i, 2] * q[i, 1], -p[i, 2] * q[i, 0]
    a10, a11 = p[j, 2] * q[j, 1], -p[j, 2] * q[j, 0]
    c00, c01 = -q[i, 2] * p[i, 1], q[i, 2] * p[i, 0]
    c10, c11 = -q[j, 2] * p[j, 1], q[j, 2] * p[j, 0]
    det = a00 * a11 - a01 * a10
    if abs(det) < 1e-9:
        return 0
    m00, m01 = -(a11 * c00 - a01 * c10) / det, -(a11 * c01 - a01 * c11) / det
    m10, m11 = -(a00 * c10 - a10 * c00) / det, -(a00 * c11 - a10 * c01) / det
    s = m00 * m00 + m10 * m10 - 1
    t = m01 * m01 + m11 * m11 - 1
    c = m00 * m01 + m10 * m11
    # s cos^2 + 2 c cos sin + t sin^2 = 0, that is (s + t) / 2 + (s - t) / 2 cos 2 beta + c sin 2 beta = 0
    # noise may leave no solution: the nearest is taken; without parallax, s = t = c = 0, every direction is one
    cosine = -(s + t) / 2 / (math.hypot((s - t) / 2, c) + 1e-300)
    middle, apart = math.atan2(c, (s - t) / 2), math.acos(min(max(cosine, -1.0), 1.0))
    for k in range(2):
        beta = (middle + (1 - 2 * k) * apart) / 2
        cb, sb = math.cos(beta), math.sin(beta)
        out[k, 0] = math.atan2(m10 * cb + m11 * sb, m00 * cb + m01 * sb)
        out[k, 1] = beta
    return 2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def linear(p, q, which, out):  # type: ignore[no-untyped-def]
    """Linear solver: the motion (g, beta) of the four entries of E that fit K >= 4 matches `which`, up to half a turn, in `out`."""
    rows = np.empty((len(which), 4))
    for k in range(len(which)):
        i = which[k]
        rows[k, 0], rows[k, 1] = q[i, 2] * p[i, 0], q[i, 2] * p[i, 1]
        rows[k, 2], rows[k, 3] = p[i, 2] * q[i, 0], p[i, 2] * q[i, 1]
    _, vectors = np.linalg.eigh(rows.T @ rows)
    e13, e23, e31, e32 = vectors[:, 0]
    out[0, 0], out[0, 1] = math.atan2(-e31, e32), math.atan2(e13, -e23)
    return 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def ransac(p, q, samples, limit, sure):  # type: ignore[no-untyped-def]
    """LO-RANSAC: the motion (g, beta) of least MSAC cost, each new best refined at once (Chum et al., 2003).

    Draws (n, 2) are solved by two_points, (n, K >= 4) by linear. They end once a sample of good matches only has been
    drawn with probability 1 - sure, and before that not below 20.
    """
    g, beta, least, needed = 0.0, 0.0, np.inf, 1.0 * len(samples)
    size = samples.shape[1]
    found = np.empty((2, 2))
    for k in range(len(samples)):
        if k >= 20 and k >= needed:
            break
        drawn = samples[k]
        count = two_points(p, q, drawn[0], drawn[1], found) if size == 2 else linear(p, q, drawn, found)
        for s in range(count):
            total, _ = cost(p, q, found[s, 0], found[s, 1], limit)
            if total >= least:
                continue
            g1, beta1 = refined(p, q, found[s, 0], found[s, 1], limit, 3)
            better, good = cost(p, q, g1, beta1, limit)
            if better > total:
                g1, beta1, better = found[s, 0], found[s, 1], total
            g, beta, least = g1, beta1, better
            share = (good / len(p)) ** size
            needed = math.log(sure) / math.log(1 - min(share, 1 - 1e-12) + 1e-12)
    return g, beta, least


@nb.njit(cache=True, nogil=True, error_model="numpy")
def noise_of(p, q, g, beta, limit):  # type: ignore[no-untyped-def]
    """Robust standard deviation of the errors below `limit`, from their median (Rousseeuw and Leroy, 1987)."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    errors = np.empty(len(p))
    count = 0
    for i in range(len(p)):
        e = squared_error(p[i], q[i], cg, sg, cb, sb)
        if e < limit:
            errors[count] = e
            count += 1
    if count == 0:
        return math.sqrt(limit)
    return 1.4826 * (1 + 5 / max(count - 2, 1)) * math.sqrt(np.median(errors[:count]))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def parallaxes(p, q, g, beta):  # type: ignore[no-untyped-def]
    """Parallax (M,), the angle by which points moved away from direction beta, in radians."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    out = np.empty(len(p))
    for i in range(len(p)):
        ahead = min(max(p[i, 0] * cb + p[i, 1] * sb, -1.0), 1.0)
        then = min(max(q[i, 0] * cg + q[i, 1] * sg, -1.0), 1.0)
        out[i] = math.acos(then) - math.acos(ahead)
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def beside(p, q, g, beta, off):  # type: ignore[no-untyped-def]
    """Cheirality (M,): matches on one side of beta in their epipolar plane, within errors of `off` each."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    out = np.empty(len(p), np.bool_)
    for i in range(len(p)):
        level = (p[i, 0] * sb - p[i, 1] * cb) * (q[i, 0] * sg - q[i, 1] * cg)
        out[i] = p[i, 2] * q[i, 2] + level > -off * off
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def inliers(p, q, g, beta, limit):  # type: ignore[no-untyped-def]
    """Inlier mask (M,): squared errors below `limit`."""
    cg, sg, cb, sb = math.cos(g), math.sin(g), math.cos(beta), math.sin(beta)
    out = np.empty(len(p), np.bool_)
    for i in range(len(p)):
        out[i] = squared_error(p[i], q[i], cg, sg, cb, sb) < limit
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def pure_rotation(p, q, noise):  # type: ignore[no-untyped-def]
    """Least-squares rotation without translation, and its variance."""
    across, along = 0.0, 0.0
    for i in range(len(p)):
        across += q[i, 0] * p[i, 1] - q[i, 1] * p[i, 0]
        along += q[i, 0] * p[i, 0] + q[i, 1] * p[i, 1]
    return math.atan2(across, along), 2 * noise * noise / max(math.hypot(across, along), 1e-12)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def planar_motion(p, q, samples, tolerance, finest):  # type: ignore[no-untyped-def]
    """Robust estimate of planar motion: phi, beta, their variances and covariance, noise, inliers, parallax in standard
    deviations, and phi with its variance under pure rotation.

    After RANSAC the noise is that of the matches within `tolerance`, and those within three of it are fitted. A wrong
    match that happens to lie on its epipolar line mostly does so far along it, where it would weigh the most; so matches
    of negative parallax, of more than four times the median, or on the other side of the direction, are rejected.
    """
    limit = tolerance * tolerance
    g, beta, least = ransac(p, q, samples, limit, 1e-4)
    if not np.isfinite(least):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0
    noise = max(noise_of(p, q, g, beta, limit), finest)
    g, beta = refined(p, q, g, beta, min(limit, 9 * noise * noise), 10)
    noise = max(noise_of(p, q, g, beta, limit), finest)
    near = min(limit, 9 * noise * noise)

    kept_p, kept_q, parallax = p, q, 0.0
    for _ in range(3):
        fits = inliers(p, q, g, beta, near)
        kept_p, kept_q = p[fits], q[fits]
        if len(kept_p) == 0:
            break
        back = parallaxes(kept_p, kept_q, g, beta)
        apart = math.sqrt(2.0) * noise
        parallax = np.minimum(np.maximum(back / apart, -10), 10).sum() / math.sqrt(len(back))
        if parallax < 0:
            g, beta, back = g + math.pi, beta + math.pi, -back
        plausible = (
            beside(kept_p, kept_q, g, beta, 3 * noise) & (back > -3 * apart) & (back < 4 * np.median(back) + 3 * apart)
        )
        kept_p, kept_q = kept_p[plausible], kept_q[plausible]
        g, beta = refined(kept_p, kept_q, g, beta, near, 10)
    h00, h01, h11, _b0, _b1, ee, count = normal_equations(kept_p, kept_q, g, beta, near)
    noise = max(math.sqrt(ee / max(count - 2, 1) / 0.9733), finest)  # a normal distribution cut at three sigma: 0.9733
    det = max(h00 * h11 - h01 * h01, 1e-30)
    vg, vb, cov = noise**2 * h11 / det, noise**2 * h00 / det, -(noise**2) * h01 / det
    phi, variance = pure_rotation(kept_p, kept_q, noise)
    return beta - g, beta, vg + vb - 2 * cov, vb, vb - cov, noise, count, abs(parallax), phi, variance
