"""The conformance check of odometries."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from omnilab import api
from omnilab.testing.common import check_common, expect


def check_odometry(odometry: Any, frames: api.Frames) -> None:
    """Frames of a short path (N at least 3, with poses) give the same one by one as in a batch; motions are sound.

    Deterministic by seed; covariances are positive definite; pickles.
    """
    odometry = check_common("odometry", odometry)
    extracted = odometry.extract(frames)
    expect(len(extracted) == len(frames) >= 3, f"{len(frames)} images are extracted as {len(extracted)}")
    expect(not any(isinstance(one, api.Unusable) for one in extracted), "good images are unusable")
    for before, now in pairwise(extracted):
        motion = odometry.estimate(before, now, np.random.default_rng(1))
        again = odometry.estimate(before, now, np.random.default_rng(1))
        expect(not motion.failed, f"the motion between two good images is not estimated: {motion.failed}")
        expect(motion.unit != "", "motions have no unit; say 'm', or what lengths count")
        expect(
            np.shape(motion.vector) == (3,) and bool(np.isfinite(motion.vector).all()), f"a motion is {motion.vector}"
        )
        expect(np.array_equal(motion.vector, again.vector), "the same seed gives another motion the second time")
        expect(
            np.shape(motion.covariance) == (3, 3), f"covariances have shape {np.shape(motion.covariance)}, not (3, 3)"
        )
        expect(bool((np.linalg.eigvalsh(motion.covariance) > 0).all()), "covariances are not positive definite")
    (alone,) = odometry.extract(frames.at(len(frames) - 1))
    single = odometry.estimate(extracted[-2], alone, np.random.default_rng(1)).vector
    expect(bool(np.allclose(single, motion.vector)), "an image extracted alone gives another motion than in a batch")
