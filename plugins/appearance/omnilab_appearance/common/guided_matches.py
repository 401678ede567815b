"""Matches along epipolar great circles, once the relative pose of two images is known."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Floats, ImageFeatures, Ints
from omnilab_appearance.common.relative_pose import RelativePose, essential
from omnilab_appearance.common.spherical_features import directions_of
from omnilab_appearance.common.vectors import unit

APART = -2.0  # less than any cosine


def guided_matches(
    before: ImageFeatures,
    now: ImageFeatures,
    pose: RelativePose,
    tolerance_rad: float,
    ratio: float,
    least_cosine: float,
) -> tuple[Ints, Ints]:
    """Indices (M,), (M,) of features that are each other's nearest among those that a relative pose allows.

    Where few features can be the other one, a match need not stand out as clearly as among all (Hartley and Zisserman,
    2004, 11.6): the second best of `ratio` (Lowe, 2004) is the second best that the pose allows, and the cosine between
    the two vectors is at least `least_cosine`, without which some feature along the circle would always do.
    """
    import cv2

    a, b = unit(before.vectors.astype(np.float32)), unit(now.vectors.astype(np.float32))
    cosine = np.asarray(cv2.gemm(a, b, 1.0, None, 0.0, flags=cv2.GEMM_2_T))
    cosine[~allowed(directions_of(before), directions_of(now), pose, tolerance_rad)] = APART
    rows, partner = np.arange(len(a)), cosine.argmax(axis=1)
    best = cosine[rows, partner].copy()
    mutual = cosine.argmax(axis=0)[partner] == rows
    cosine[rows, partner] = APART
    clear = 1 - best < ratio**2 * (1 - np.maximum(cosine.max(axis=1), 0))
    chosen = np.flatnonzero(mutual & clear & (best >= least_cosine))
    return chosen, partner[chosen]


def allowed(p: Floats, q: Floats, pose: RelativePose, tolerance_rad: float) -> Bools:
    """Which directions p (F, 3) and q (G, 3) may be of one point (F, G): within a tolerance in one epipolar plane, on one
    side of the translation, and moved away from its direction."""
    E, g = essential(pose.phi, pose.beta), pose.beta - pose.phi
    Eq, Ep = q @ E.T, p @ E
    r = Ep @ q.T
    scale = (Ep**2).sum(axis=1)[:, None] + (Eq**2).sum(axis=1) - 2 * r**2 + 1e-12
    plane = r**2 < tolerance_rad**2 * scale  # Sampson's error, as in `sampson_errors`
    ahead, then = (np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in (pose.beta, g))
    left = np.outer(p[:, 0] * ahead[1] - p[:, 1] * ahead[0], q[:, 0] * then[1] - q[:, 1] * then[0])
    side = np.outer(p[:, 2], q[:, 2]) + left > -(tolerance_rad**2)
    back = np.arccos(np.clip(q @ then, -1, 1)) - np.arccos(np.clip(p @ ahead, -1, 1))[:, None]
    return np.asarray(plane & side & (back > -2 * tolerance_rad))
