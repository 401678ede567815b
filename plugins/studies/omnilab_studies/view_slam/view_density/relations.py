"""One way of relating images, shared by all maps that use it; and how alike images are against their distance."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Frames, Motion, Odometry, Unusable
from omnilab.geometry import wrap_angle
from omnilab_studies.view_slam.front_end import angles_of, similarity

CLEAR_DEG = 5.0  # off the true bearing by more, an estimate is wrong


class ComparedPair(NamedTuple):
    """Two images that were compared."""

    distance_m: float
    similarity: float  # R (Gil et al., 2012, eq. 13)
    bearing_error_deg: float  # NaN where the estimate failed


class Relations:
    """The features of images, by their numbers, and relative poses of the present image, each estimated once."""

    def __init__(self, odometry: Odometry, seed: int) -> None:
        self._odometry, self._seed = odometry, seed
        self.features: dict[int, Any] = {}
        self.pairs: list[ComparedPair] = []
        self.extract_s, self.relate_s = list[float](), list[float]()  # processor time of each
        self._present: dict[int, Motion] = {}

    def extract(self, image: int, frame: Frames) -> Any:
        """The features of the next image, a batch of one."""
        start = time.thread_time()
        (self.features[image],) = self._odometry.extract(frame)
        self.extract_s.append(time.thread_time() - start)
        self._present.clear()
        return self.features[image]

    def relate(self, image: int, view: int) -> Motion:
        """The motion from the present image to an earlier one, the same for all that ask."""
        if view not in self._present:
            rng, start = np.random.default_rng([self._seed, image, view]), time.thread_time()
            self._present[view] = self._odometry.estimate(self.features[image], self.features[view], rng)
            self.relate_s.append(time.thread_time() - start)
        return self._present[view]

    def compare(self, image: int, references: Sequence[int], truth: Sequence[Floats], range_m: float) -> None:
        """Compare the present image with earlier ones within a range, by true poses (3,) of all images."""
        if isinstance(self.features[image], Unusable):
            return
        for other in references:
            d = truth[other][:2] - truth[image][:2]
            distance_m = float(np.hypot(*d))
            if isinstance(self.features[other], Unusable) or not 0.02 < distance_m < range_m:
                continue
            motion, error = self.relate(image, other), float("nan")
            if not motion.failed:
                (bearing, _), _ = angles_of(motion, 0.0)
                error = float(np.rad2deg(abs(wrap_angle(bearing + truth[image][2] - np.arctan2(d[1], d[0])))))
            self.pairs.append(ComparedPair(distance_m, similarity(motion), error))


def binned(name: str, pairs: Sequence[ComparedPair], edges_m: Sequence[float]) -> list[dict[str, Any]]:
    """Rows of R against distance: medians and quartiles of the pairs between each two edges; none without pairs."""
    found = []
    for low, high in pairwise(edges_m):
        own = [pair for pair in pairs if low <= pair.distance_m < high]
        if not own:
            continue
        R, error = np.array([pair.similarity for pair in own]), np.array([pair.bearing_error_deg for pair in own])
        quartiles = np.percentile(R, [25, 50, 75])
        found.append({
            "method": name, "distance_m": float(np.mean([pair.distance_m for pair in own])), "pairs": len(own),
            "similarity": float(quartiles[1]), "similarity_low": float(quartiles[0]),
            "similarity_high": float(quartiles[2]), "failed": float(np.isnan(error).mean()),
            "bearing_error_deg": float(np.nanmedian(error)) if np.isfinite(error).any() else float("nan"),
            "wrong": float((error > CLEAR_DEG).mean()),
        })  # fmt: skip
    return found
