"""Odometry from global appearance and a vote on the direction of motion, as printed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Frames, ImageFeatures, Motion, Signatures, Unusable, check_settings, setting
from omnilab.geometry import wrap_angle
from omnilab.image import PANORAMA_SHAPE, view_of
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.spherical_features import MOST_ROWS, match_features, spherical_features
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.distances.poc import Poc

SAME = 1e-6  # POC distance below which two images are the same one
STARTS = PANORAMA_SHAPE[1]  # of the window, whatever the size of the panorama


class Ties(Enum):
    """Which of the windows with the highest count wins."""

    first = "first"  # as printed
    middle = "middle"  # of the run that they make


class AppearanceFeatures(NamedTuple):
    """The Radon transform and the local features of an image."""

    radon: Signatures  # of one image
    local: ImageFeatures


@dataclass
class Appearance:
    """Odometry from global appearance and the sense in which features move (Berenguer, thesis, 6.2).

    The rotation is that of the Radon transforms by phase-only correlation, and their distance the length of the step, in
    an unknown unit (eq. 6.4, 6.5). The first panorama is rotated by that, and a window of half its width slides along
    it: matches that moved one way count inside, those that moved the other way outside, and the highest count gives the
    direction of motion (eq. 6.3). Azimuths grow counter-clockwise here, so matches to the right of the direction of
    motion move towards smaller ones.
    """

    detector: Detector = Detector.surf  # as printed; or sift
    features: int = setting(400, at_least=1, at_most=10_000)  # at most so many of each image
    panorama_rows: int | None = setting(
        None, at_least=32, at_most=MOST_ROWS
    )  # of the panorama that they are found on, 4 columns each; not given: the camera's own resolution
    ratio: float = setting(0.8, above=0, at_most=1)  # of Lowe's test
    least: int = setting(10, at_least=2)  # matches; with fewer the estimate fails
    ties: Ties = Ties.first  # as printed; or middle of the windows that win
    squared: bool = False  # the square of the distance: more linear over a metre (eq. 4.4), with a larger spread
    offsets: int = setting(173, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(180, at_least=4, at_most=4096)  # of the Radon transform
    turn_sigma_deg: float = setting(1.0, at_least=1e-6, at_most=1e6)  # standard deviation of a rotation
    direction_sigma_deg: float = setting(15.0, at_least=1e-6, at_most=1e6)  # of a direction of motion
    length_sigma: float = setting(0.2, at_least=1e-6, at_most=1e6)  # of a length, as a share of it

    def __post_init__(self) -> None:
        check_settings(self)

    def extract(self, frames: Frames) -> list[AppearanceFeatures | Unusable]:
        """The Radon transform and the features of each image."""
        radon = Radon(self.offsets, self.angles).describe(view_of(frames.images, frames.camera, "mirror", False))
        found = spherical_features(frames, self.detector, self.features, self.least, self.panorama_rows)
        return [f if isinstance(f, Unusable) else AppearanceFeatures(radon[i : i + 1], f) for i, f in enumerate(found)]

    def estimate(self, before: AppearanceFeatures, now: AppearanceFeatures, rng: np.random.Generator) -> Motion:  # noqa: ARG002
        """Rotation, length and direction; draws nothing."""
        poc = Poc()
        match = poc.match(now.radon, poc.prepare(before.radon))
        assert match.rotation_rad is not None
        rotation, distance = float(match.rotation_rad[0, 0]), float(match.distance[0, 0])
        here, there = match_features(before.local, now.local, self.ratio)
        matches = np.stack([before.local.azimuth_level[here], now.local.azimuth_level[there]], axis=1)
        unknown = np.array([np.nan, np.nan, rotation])
        if distance < SAME:
            return Motion(unknown, np.eye(3), "poc", "it is the picture before once more", matches)
        if len(here) < self.least:
            return Motion(unknown, np.eye(3), "poc", f"{len(here)} features match", matches)
        azimuth = matches[:, 1, 0].astype(float)
        moved = wrap_angle(azimuth - matches[:, 0, 0] + rotation)
        beta, window, offset = self._direction(azimuth, moved)
        agree = np.sin(azimuth - beta) * wrap_angle(moved - offset) > 0
        length = distance**2 if self.squared else distance
        vector, covariance = self._vector(float(wrap_angle(rotation - offset)), length, rotation - offset + beta)
        features = len(before.local.azimuth_level) + len(now.local.azimuth_level)
        return Motion(vector, covariance, "poc", "", matches, agree, features, window)

    def _direction(self, azimuth_rad: Floats, moved_rad: Floats) -> tuple[float, float | None, float]:
        """The direction of motion in the new frame, the start of the winning window, and the error of the rotation."""
        counts = votes(azimuth_rad, moved_rad)
        best = np.flatnonzero(counts == counts.max())
        start = 2 * np.pi / STARTS * (best[0] if self.ties is Ties.first else middle_of(best, STARTS))
        return float(start + np.pi), float(start), 0.0

    def _vector(self, rotation: float, length: float, direction: float) -> tuple[Floats, Floats]:
        """The motion (3,) and its covariance (3, 3)."""
        c, s = np.cos(direction), np.sin(direction)
        J = np.array([[c, -length * s, 0], [s, length * c, 0], [0, 0, 1.0]])  # of length, direction, rotation
        deviation = [self.length_sigma * length, np.deg2rad(self.direction_sigma_deg), np.deg2rad(self.turn_sigma_deg)]
        return np.array([length * c, length * s, rotation]), J @ np.diag(np.square(deviation)) @ J.T


def votes(azimuth_rad: Floats, moved_rad: Floats) -> Any:
    """Votes (STARTS,): matches that moved to smaller azimuths within half a turn from each start, to larger ones elsewhere."""
    starts = 2 * np.pi * np.arange(STARTS) / STARTS
    inside = np.mod(azimuth_rad - starts[:, None], 2 * np.pi) < np.pi
    return (inside & (moved_rad < 0)).sum(axis=1) + (~inside & (moved_rad > 0)).sum(axis=1)


def middle_of(chosen: Any, count: int) -> float:
    """The middle of the longest run of consecutive numbers among `chosen` (K,), modulo `count`."""
    if len(chosen) == count:
        return 0.0
    gaps = np.diff(np.append(chosen, chosen[0] + count))
    starts = np.roll(np.flatnonzero(gaps > 1) + 1, 1) % len(chosen)
    ends = np.flatnonzero(gaps > 1)
    lengths = np.mod(chosen[ends] - chosen[starts], count)
    longest = int(lengths.argmax())
    return float(chosen[starts[longest]] + lengths[longest] / 2) % count
