"""Rotation by matched features of the sphere under the epipolar constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, setting
from omnilab.geometry import rotation_xyz
from omnilab_appearance.common.ray_rotation import LEAST, relative_orientation
from omnilab_appearance.common.relative_pose import pose_of
from omnilab_appearance.distances.feature_rotation import FeatureRotation


@dataclass
class EpipolarRotation(FeatureRotation):
    """`feature_rotation` for images of two places: what agrees is what the epipolar constraint of one motion allows.

    From the rotations that most matches are near to, as `feature_rotation` draws them, rotation and direction of the
    translation (five unknowns) are fitted to all matches, those outweighed that lie farther than `tolerance_deg` from their
    epipolar planes (iteratively reweighted Gauss-Newton on Sampson's error); the fit with most inliers is answered.
    Parallax, which a rotation alone cannot explain, costs it nothing.

    From far apart no rotation alone is near to most matches, and none of the starts may be any good. `planar` is for upright
    cameras at one height: heading and direction in the plane are all that is unknown, two matches give both, and RANSAC over
    `draws` of them finds the motion whatever the parallax, as odometry `planar_epipolar` does. Without eight matches that
    agree it is the identity, and none agrees.
    """

    tolerance_deg: float = setting(1.0, above=0, at_most=45)  # of a match from its epipolar plane
    starts: int = setting(12, at_least=1, at_most=1000)  # rotations from which it is fitted, unless planar
    planar: bool = False  # both cameras are upright and at one height: two unknowns instead of five

    def rotation(self, place: Floats, query: Floats) -> tuple[Floats, Bools]:
        """R_place_query (3, 3) of matched directions (M, 3), and which agree."""
        rng, p, q = np.random.default_rng(self.seed), place.astype(float), query.astype(float)
        if not self.planar:
            return relative_orientation(p, q, rng, np.deg2rad(self.tolerance_deg), self.draws, self.starts)
        found = pose_of(p, q, rng, tolerance_deg=self.tolerance_deg, draws=self.draws, least_matches=LEAST)
        return rotation_xyz(0, 0, np.nan_to_num(found.phi)), found.agree
