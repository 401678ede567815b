"""Odometry by the epipolar geometry of planar motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import CalibratedCamera, Floats, Frames, Motion, Unusable
from omnilab.errors import ConfigError
from omnilab.projection import view_of
from omnilab_appearance.lengths import floor_length, poc_length
from omnilab_appearance.planar import RelativePose, Solver, relative_pose, turned_back
from omnilab_appearance.radon import Radon
from omnilab_appearance.sightings import Features, Sighting, matches

HEIGHTS = "camera heights"


class Length(Enum):
    """How the length of a step is told."""

    floor = "floor"
    poc = "poc"


class Seen(NamedTuple):
    """What is kept of an image."""

    sighting: Sighting
    radon: Floats | None  # (1, N, M), where lengths are told by it


@dataclass
class PlanarEpipolar:
    """Turn and direction from matching local features under the epipolar constraint of planar motion (Gil et al., 3.2).

    The constraint leaves the length open. `floor`: what lies below the horizon mostly lies on the floor, so where
    matched features moved there tells the step in heights of the camera above it, or in metres if that height is given.
    `poc`: the distance by phase-only correlation of two Radon transforms, which grows with the step (Berenguer, thesis,
    eq. 6.4, 6.5); its unit is not known.
    """

    features: Features = field(default_factory=Features)  # what finds local features
    ratio: float = 0.85  # a match is so much nearer than the second best, both ways
    solver: Solver = Solver.two_point  # of each draw: two_point, or linear as printed
    draws: int = 300  # of matches, at most
    tolerance_deg: float = 0.35  # how far a match may be from the constraint
    least: int = 20  # matches that agree, or the step has failed
    length: Length = Length.floor  # or poc
    height_m: float | None = None  # of the viewpoint above the floor; null: lengths are in such heights
    poc_sigma: float = 0.2  # standard deviation of a length by poc, as a share of it
    caution: float = 2.0  # times the deviations that matches tell of themselves: their errors are not independent

    def __post_init__(self) -> None:
        if not 0 < self.ratio <= 1:
            raise ConfigError(f"ratio={self.ratio:g} is not that of two distances; give a number above 0 and up to 1")
        if not 0 < self.tolerance_deg < 90 or self.draws < 1 or self.least < 4:
            raise ConfigError(
                f"tolerance_deg={self.tolerance_deg:g}, draws={self.draws}, least={self.least} find no motion; give degrees"
                " below 90, 1 draw or more and 4 matches or more"
            )
        if self.height_m is not None and not self.height_m > 0:
            raise ConfigError(f"height_m={self.height_m:g} is not above the floor; give metres above 0, or null")

    @property
    def unit(self) -> str:
        """Of lengths."""
        if self.length is Length.poc:
            return "poc"
        return HEIGHTS if self.height_m is None else "m"

    def look(self, frames: Frames) -> list[Seen | Unusable]:
        """Features, and the Radon transform where it tells lengths; ConfigError for cameras that are not calibrated."""
        if not isinstance(frames.camera, CalibratedCamera):
            raise ConfigError(
                f"planar_epipolar needs to know where pixels look, and a {type(frames.camera).__name__} does not tell; give"
                " the sensor a calibration, or choose odometry=appearance"
            )
        found = self.features.sightings(frames)
        if self.length is Length.poc:
            radon = Radon().describe(view_of(frames.images, frames.camera, "mirror", False)).place
            return [s if isinstance(s, Unusable) else Seen(s, radon[i : i + 1]) for i, s in enumerate(found)]
        return [s if isinstance(s, Unusable) else Seen(s, None) for s in found]

    def motion(self, before: Seen, now: Seen, rng: np.random.Generator) -> Motion:
        """Turn and direction by the matches, the length by the floor or by phase-only correlation."""
        one, other, pose = self.relative(before.sighting, now.sighting, rng)
        p, q = directions_of(before.sighting)[one], directions_of(now.sighting)[other]
        seen = np.stack([before.sighting.azimuth_level[one], now.sighting.azimuth_level[other]], 1)
        told: dict[str, Any] = {"unit": self.unit, "matches": seen, "agree": pose.agree}
        if pose.failed:
            return Motion(np.array([np.nan, np.nan, pose.phi_rad]), np.eye(3), failed=pose.failed, **told)
        if self.length is Length.floor:
            good = pose.agree
            length, sigma, failed = floor_length(p[good], turned_back(q[good], pose.phi_rad), pose.beta_rad)
            if failed:
                return Motion(np.array([np.nan, np.nan, pose.phi_rad]), np.eye(3), failed=failed, **told)
            scale = self.height_m or 1.0
            length, sigma = scale * length, scale * sigma
        else:
            assert before.radon is not None
            assert now.radon is not None
            length = poc_length(before.radon, now.radon)
            sigma = self.poc_sigma * length
        vector, covariance = planar_motion(pose, length, sigma)
        return Motion(vector, self.caution**2 * covariance, **told)

    def relative(self, before: Sighting, now: Sighting, rng: np.random.Generator) -> tuple[Any, Any, RelativePose]:
        """Matching features (M,) of two pictures, and the relative pose that they tell."""
        one, other = matches(before, now, self.ratio)
        p, q = directions_of(before)[one], directions_of(now)[other]
        tolerance = float(np.deg2rad(self.tolerance_deg))
        return one, other, relative_pose(p, q, rng, self.solver, tolerance, self.draws, self.least)


def directions_of(sighting: Sighting) -> Floats:
    """Unit directions (F, 3) of features whose camera knows them."""
    assert sighting.directions is not None
    return sighting.directions


def planar_motion(pose: RelativePose, length: float, sigma: float) -> tuple[Floats, Floats]:
    """x, y and heading (3,), and their covariance (3, 3), of a relative pose and a length with its deviation."""
    c, s = np.cos(pose.beta_rad), np.sin(pose.beta_rad)
    J = np.array([[0, -length * s, c], [0, length * c, s], [1, 0, 0]])  # of phi, beta, length
    spread = np.zeros((3, 3))
    spread[:2, :2], spread[2, 2] = pose.covariance, sigma**2
    return np.array([length * c, length * s, pose.phi_rad]), J @ spread @ J.T
