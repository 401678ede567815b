"""Rotation by matched features of the sphere under the epipolar constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, setting
from omnilab_appearance.common.ray_rotation import relative_orientation
from omnilab_appearance.distances.feature_rotation import FeatureRotation


@dataclass
class EpipolarRotation(FeatureRotation):
    """`feature_rotation` for images of two places: what agrees is what the epipolar constraint of one motion allows.

    From the rotations that most matches are near to, as `feature_rotation` draws them, rotation and direction of the
    translation (five unknowns) are fitted to all matches, those outweighed that lie farther than `tolerance_deg` from their
    epipolar planes (iteratively reweighted Gauss-Newton on Sampson's error); the fit with most inliers is answered.
    Parallax, which a rotation alone cannot explain, costs it nothing.
    """

    tolerance_deg: float = setting(1.0, above=0, at_most=45)  # of a match from its epipolar plane
    starts: int = setting(12, at_least=1, at_most=1000)  # rotations from which it is fitted

    def rotation(self, place: Floats, query: Floats) -> tuple[Floats, Bools]:
        """R_place_query (3, 3) of matched directions (M, 3), and which agree."""
        rng, tolerance = np.random.default_rng(self.seed), np.deg2rad(self.tolerance_deg)
        return relative_orientation(place.astype(float), query.astype(float), rng, tolerance, self.draws, self.starts)
