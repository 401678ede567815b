"""Loop closures that a description proposes and geometry confirms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import CalibratedCamera, Closures, Frames, Ints, Unusable
from omnilab.errors import ConfigError
from omnilab.projection import view_of
from omnilab_appearance.hog_threshold import check_memory, closures, hog_of, none
from omnilab_appearance.planar_epipolar import PlanarEpipolar, Seen
from omnilab_appearance.radon import Radon
from omnilab_appearance.radon_hog import RadonHog
from omnilab_appearance.remembered import Remembered
from omnilab_appearance.sightings import Sighting


@dataclass
class Verified:
    """Earlier images whose HOG of the Radon transform is most alike, of which local features confirm one place.

    They do so where enough matches agree with one motion in the plane, and have moved little besides the turn: that is
    what tells the same place from the same room. The turn is that of the geometry. Images taken shortly before are left
    out, and candidates that are much less alike than an image and the one before it.
    """

    geometry: PlanarEpipolar = field(default_factory=PlanarEpipolar)  # its matches and tolerances; not its lengths
    candidates: int = 3  # that geometry looks at, the most alike
    alike: float = 5.0  # how much further apart than usual neighbours in time candidates may be
    least: int = 40  # matches that agree
    share: float = 0.4  # of the matches that agree
    parallax_deg: float = 4.0  # root mean square, of matches that agree: at most
    parallax_steps: float = 2.0  # and at most so many times that of usual neighbours in time, near walls or far
    exclude: int = 30  # images just before that are not compared with
    most: int = 1  # closures of an image, those that moved least
    reach: float = 1.0  # standard deviation of the position, in usual steps
    turn_sigma_deg: float = 0.5  # and of the heading, at least
    cells: int = 16  # of the HOG
    bins: int = 8  # of the HOG

    def __post_init__(self) -> None:
        check_memory(self.exclude, self.most, self.reach, self.turn_sigma_deg)
        if self.candidates < 1 or not self.alike > 0:
            raise ConfigError(
                f"candidates={self.candidates}, alike={self.alike:g} propose nothing; give 1 or more, above 0"
            )
        if self.least < 4 or not 0 <= self.share <= 1 or not min(self.parallax_deg, self.parallax_steps) > 0:
            raise ConfigError(
                f"least={self.least}, share={self.share:g}, parallax_deg={self.parallax_deg:g}, parallax_steps="
                f"{self.parallax_steps:g} confirm nothing; give 4 matches"
                " or more, a share up to 1, and the others above 0"
            )
        RadonHog(self.cells, self.bins)

    def begin(self) -> VerifiedMemory:
        """A memory without images."""
        return VerifiedMemory(self)


class VerifiedMemory:
    """Descriptions and features of all images so far."""

    def __init__(self, settings: Verified) -> None:
        self._settings, self._hogs = settings, Remembered()
        self._sightings: list[Sighting | None] = []  # None of what is unusable
        self._steps: list[float] = []  # distances between images that follow each other
        self._parallaxes: list[float] = []  # and what matches moved between them

    def recall(self, frames: Frames, look: Any, step: float, rng: np.random.Generator) -> Closures:
        """See `omnilab.api.Memory`."""
        s = self._settings
        sighting = self._sighting(frames, look)
        transform = Radon().describe(view_of(frames.images, frames.camera, "mirror", False)).place
        self._hogs.add(np.zeros(s.cells * s.bins) if sighting is None else hog_of(transform, s.cells, s.bins))
        self._sightings.append(sighting)
        if sighting is None or len(self._hogs) < 2:
            return none(0)
        self._steps.append(float(self._hogs.distances(0)[-1]))
        self._watch(sighting, rng)
        distances = self._hogs.distances(s.exclude)
        likely = np.argsort(distances, kind="stable")[: s.candidates]
        likely = likely[distances[likely] <= s.alike * np.median(self._steps)]
        confirmed = [found for node in likely.tolist() if (found := self._confirmed(node, sighting, rng))]
        confirmed = sorted(confirmed)[: s.most]
        nodes: Ints = np.array([node for _, node, _, _ in confirmed], int)
        turns, sigmas = (np.array([found[k] for found in confirmed]) for k in (2, 3))
        return closures(nodes, turns, sigmas, s.reach * step, distances[nodes], len(likely))

    def _sighting(self, frames: Frames, look: Any) -> Sighting | None:
        """The image's features: those that the odometry has found already, or else its own."""
        if isinstance(look, Unusable):
            return None
        if isinstance(look, Seen):
            return look.sighting
        if not isinstance(frames.camera, CalibratedCamera):
            raise ConfigError(
                f"verified needs to know where pixels look, and a {type(frames.camera).__name__} does not tell; give the"
                " sensor a calibration, or choose loop_closure=hog_threshold"
            )
        (found,) = self._settings.geometry.features.sightings(frames)
        return None if isinstance(found, Unusable) else found

    def _watch(self, now: Sighting, rng: np.random.Generator) -> None:
        """Note how far matches move in a step: what is near moves more, in a corridor more than in a hall."""
        before = self._sightings[-2]
        if before is not None:
            pose = self._settings.geometry.relative(before, now, rng)[2]
            if pose.turned:
                self._parallaxes.append(pose.parallax_rad)

    def _confirmed(self, node: int, now: Sighting, rng: np.random.Generator) -> tuple[float, int, float, float] | None:
        """Parallax, node, turn and its deviation, if an image shows the place of a node."""
        s, before = self._settings, self._sightings[node]
        if before is None:
            return None
        one, _, pose = s.geometry.relative(before, now, rng)
        if not pose.turned or pose.agree.sum() < max(s.least, s.share * len(one)):
            return None
        usual = float(np.median(self._parallaxes)) if self._parallaxes else np.inf
        if pose.parallax_rad > min(np.deg2rad(s.parallax_deg), s.parallax_steps * usual):
            return None
        sigma = s.geometry.caution * float(np.sqrt(min(pose.covariance[0, 0], 1.0)))
        return pose.parallax_rad, node, pose.phi_rad, max(sigma, float(np.deg2rad(s.turn_sigma_deg)))
