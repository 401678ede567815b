"""The conformance check of odometries."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from omnilab import api
from omnilab.testing.common import check_common, expect


def check_odometry(odometry: Any, frames: api.Frames) -> None:
    """Frames of a short way (N at least 3, with their poses) are looked at one by one as in a batch; motions are sound.

    Deterministic by seed; covariances are positive definite; pickles.
    """
    check_common("odometry", odometry)
    looks = odometry.extract(frames)
    expect(len(looks) == len(frames) >= 3, f"{len(frames)} images are looked at as {len(looks)}")
    expect(not any(isinstance(look, api.Unusable) for look in looks), "images that were said to be good are unusable")
    for before, now in pairwise(looks):
        told = odometry.estimate(before, now, np.random.default_rng(1))
        again = odometry.estimate(before, now, np.random.default_rng(1))
        expect(not told.failed, f"the motion between two good images is not told: {told.failed}")
        expect(told.unit != "", "motions have no unit; say 'm', or what lengths count")
        expect(np.shape(told.vector) == (3,) and bool(np.isfinite(told.vector).all()), f"a motion is {told.vector}")
        expect(np.array_equal(told.vector, again.vector), "the same seed gives another motion the second time")
        expect(np.shape(told.covariance) == (3, 3), f"covariances have shape {np.shape(told.covariance)}, not (3, 3)")
        expect(bool((np.linalg.eigvalsh(told.covariance) > 0).all()), "covariances are not positive definite")
    (alone,) = odometry.extract(frames.at(len(frames) - 1))
    single = odometry.estimate(looks[-2], alone, np.random.default_rng(1)).vector
    expect(bool(np.allclose(single, told.vector)), "an image looked at alone gives another motion than in a batch")
