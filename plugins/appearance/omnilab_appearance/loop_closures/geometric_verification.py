"""Loop closures that a description proposes and geometry confirms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Closures, Floats, Frames, Ints, Unusable
from omnilab.errors import ConfigError
from omnilab.image import view_of
from omnilab_appearance.common.ground_scale import floor_step, turned
from omnilab_appearance.common.relative_pose import RelativePose
from omnilab_appearance.common.spherical_features import Sighting, check_calibrated
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.descriptors.radon_hog import RadonHog
from omnilab_appearance.loop_closures.cosine_index import Remembered
from omnilab_appearance.loop_closures.hog_threshold import check_memory, hog_of, none
from omnilab_appearance.odometries.planar_epipolar import PlanarEpipolar, propagated

EVERY = 5  # images: how often the length of a step is measured
LEAST = 0.2  # usual steps: standard deviation of a position, at least


@dataclass
class GeometricVerification:
    """Earlier images whose HOG of the Radon transform is most alike, of which local features confirm one place.

    They do so where enough matches agree with one motion in the plane, and have moved little besides the turn: that is
    what tells the same place from the same room. Turn and direction are those of the geometry; the length is told by the
    floor, in usual steps, of which now and then one is measured in the same way. Images taken shortly before are left
    out, and candidates that are much less alike than an image and the one before it.
    """

    geometry: PlanarEpipolar = field(default_factory=PlanarEpipolar)  # its matches and tolerances; not its lengths
    candidates: int = 3  # that geometry looks at, the most alike
    alike: float = 5.0  # how much further apart than usual neighbours in time candidates may be
    least: int = 40  # matches that agree
    share: float = 0.4  # of the matches that agree
    parallax_deg: float = 4.0  # root mean square, of matches that agree: at most
    parallax_steps: float = 2.0  # and at most so many times that of usual steps, near walls or far from them
    exclude: int = 30  # images just before that are not compared with
    most: int = 1  # closures of an image, those that moved least
    pause: int = 0  # images after one with a closure that look for none: maps of ways driven over and over stay thin
    reach: float = 1.0  # standard deviation of the position where the floor tells no length, in usual steps
    turn_sigma_deg: float = 0.5  # and of the heading, at least
    cells: int = 16  # of the HOG
    bins: int = 8  # of the HOG

    def __post_init__(self) -> None:
        check_memory(self.exclude, self.most, self.reach, self.turn_sigma_deg)
        if self.candidates < 1 or not self.alike > 0:
            raise ConfigError(
                f"candidates={self.candidates}, alike={self.alike:g} propose nothing; give 1 or more, above 0"
            )
        if self.least < 4 or not 0 <= self.share <= 1 or not self.parallax_deg > 0:
            raise ConfigError(
                f"least={self.least}, share={self.share:g}, parallax_deg={self.parallax_deg:g} confirm nothing; give 4 matches"
                " or more, a share up to 1, and degrees above 0"
            )
        if self.pause < 0:
            raise ConfigError(f"pause={self.pause} is no number of images; give 0 or more")
        RadonHog(self.cells, self.bins)

    def begin(self) -> VerifiedMemory:
        """A memory without images."""
        return VerifiedMemory(self)


class Confirmed(NamedTuple):
    """A node that shows the place of an image."""

    parallax_rad: float
    node: int
    motion: Floats  # (3,)
    covariance: Floats  # (3, 3)


class VerifiedMemory:
    """Descriptions and features of all images so far."""

    def __init__(self, settings: GeometricVerification) -> None:
        self._settings, self._hogs, self._rest = settings, Remembered(), 0
        self._sightings: list[Sighting | None] = []  # None of what is unusable
        self._steps: list[float] = []  # distances between images that follow each other
        self._parallaxes: list[float] = []  # of some steps, root mean squares in radians
        self._heights: list[float] = []  # lengths of some steps, in heights of the camera

    def query(self, frames: Frames, look: Any, step: float, rng: np.random.Generator) -> Closures:
        """See `omnilab.api.PlaceDatabase`."""
        s = self._settings
        sighting = self._sighting(frames, look)
        transform = Radon().describe(view_of(frames.images, frames.camera, "mirror", False)).place
        self._hogs.add(np.zeros(s.cells * s.bins) if sighting is None else hog_of(transform, s.cells, s.bins))
        self._sightings.append(sighting)
        if sighting is None or len(self._hogs) < 2:
            return none(0)
        self._steps.append(float(self._hogs.distances(0)[-1]))
        if len(self._hogs) % EVERY == 2:  # the first step already
            self._measure(rng)
        if self._rest > 0:
            self._rest -= 1
            return none(0)
        distances = self._hogs.distances(s.exclude)
        likely = np.argsort(distances, kind="stable")[: s.candidates]
        likely = likely[distances[likely] <= s.alike * np.median(self._steps)]
        confirmed = [found for node in likely.tolist() if (found := self._confirmed(node, sighting, step, rng))]
        confirmed = sorted(confirmed, key=lambda found: found.parallax_rad)[: s.most]
        self._rest = s.pause if confirmed else 0
        nodes: Ints = np.array([found.node for found in confirmed], int)
        return Closures(
            nodes, np.array([found.motion for found in confirmed]).reshape(-1, 3),
            np.array([found.covariance for found in confirmed]).reshape(-1, 3, 3), distances[nodes], len(likely),
        )  # fmt: skip

    def _measure(self, rng: np.random.Generator) -> None:
        """How long the last step was, in heights of the camera above the floor."""
        before, now = self._sightings[-2:]
        if before is not None and now is not None:
            pose, p, q = self._settings.geometry.relative(before, now, rng)
            if not np.isnan(pose.phi):
                self._parallaxes.append(_parallax(pose, p, q))
            if not pose.failed and not (told := floor_step(p, q, pose.phi, pose.beta, pose.noise_rad)).failed:
                self._heights.append(told.length)

    def _sighting(self, frames: Frames, look: Any) -> Sighting | None:
        """The image's features: those that the odometry has found already, or else its own."""
        if isinstance(look, Unusable):
            return None
        if isinstance(look, Sighting):
            return look._replace(radon=None)
        check_calibrated(frames.camera, "loop_closure=hog_threshold")
        (found,) = self._settings.geometry.extract(frames)
        return None if isinstance(found, Unusable) else found

    def _confirmed(self, node: int, now: Sighting, step: float, rng: np.random.Generator) -> Confirmed | None:
        """What geometry says of an image and a node, if they show one place."""
        s, before = self._settings, self._sightings[node]
        if before is None:
            return None
        pose, p, q = s.geometry.relative(before, now, rng)
        if np.isnan(pose.phi) or len(p) < max(s.least, s.share * len(pose.agree)):
            return None
        parallax = _parallax(pose, p, q)
        usual = float(np.median(self._parallaxes)) if self._parallaxes else np.inf
        if parallax > min(np.deg2rad(s.parallax_deg), s.parallax_steps * usual):
            return None
        motion, covariance = np.array([0.0, 0.0, pose.phi]), np.diag([(s.reach * step) ** 2] * 2 + [0.0])
        if not pose.failed and self._heights:
            told = floor_step(p, q, pose.phi, pose.beta, pose.noise_rad)
            if not told.failed:
                unit = step / float(np.median(self._heights))
                scaled = told._replace(length=unit * told.length, variance=unit**2 * told.variance)
                motion, covariance = propagated(pose, scaled)
                covariance = covariance + np.diag([(LEAST * step) ** 2] * 2 + [0.0])
        covariance[2, 2] += np.deg2rad(s.turn_sigma_deg) ** 2
        return Confirmed(parallax, node, motion, covariance)


def _parallax(pose: RelativePose, p: Floats, q: Floats) -> float:
    """By how much matches (K, 3) that agree moved beside the turn, root mean square in radians."""
    return float(np.sqrt(np.mean((p - turned(q, pose.phi)) ** 2) * 3))
