"""Relative pose over a wide baseline: matches found anywhere, then along epipolar great circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import ImageFeatures, Ints, setting
from omnilab_appearance.common.guided_matches import guided_matches
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.relative_pose import RelativePose
from omnilab_appearance.odometries.planar_epipolar import Length, PlanarEpipolar


@dataclass
class GuidedEpipolar(PlanarEpipolar):
    """`planar_epipolar` for images that were taken far apart: upright features, and a second search for matches.

    The first search, everywhere and by `ratio`, finds the relative pose. The second one looks only along the epipolar great
    circles of that pose, where a match need not stand out as clearly (Hartley and Zisserman, 2004, 11.6), and the pose is
    estimated again from what it finds. So the similarity R of two images falls slowly with their distance. Its length is
    1: points of the floor are seldom matched from afar, and a view's bearing needs none.
    """

    detector: Detector = Detector.sift  # OpenCV's; or fast_sift
    features: int = setting(400, at_least=1, at_most=10_000)  # at most so many of each image
    upright: bool = True  # described along the panorama's axes, not along an orientation of their own; of sift
    length: Length = Length.unit  # or floor, or poc: then an estimate without a length fails
    guided_ratio: float = setting(0.95, above=0, at_most=1)  # as `ratio`, of the second search
    least_cosine: float = setting(0.75, at_least=0, at_most=1)  # between the vectors of a match of the second search

    def _matched(
        self, before: ImageFeatures, now: ImageFeatures, rng: np.random.Generator
    ) -> tuple[Ints, Ints, RelativePose]:
        """Indices (M,), (M,) of matched features, and the relative pose that they agree on."""
        i, j, pose = super()._matched(before, now, rng)
        if pose.failed:
            return i, j, pose
        i, j = guided_matches(before, now, pose, np.deg2rad(self.tolerance_deg), self.guided_ratio, self.least_cosine)
        return i, j, self._pose_of(before, now, i, j, rng)
