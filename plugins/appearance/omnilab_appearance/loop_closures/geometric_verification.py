"""Loop closures proposed by a descriptor and verified by the epipolar geometry of local features."""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from omnilab.api import Closures, Floats, Frames, ImageFeatures, Ints, Unusable, check_settings, setting
from omnilab.image import view_of
from omnilab.metrics import middle
from omnilab_appearance.common.ground_scale import ground_step, rotated
from omnilab_appearance.common.relative_pose import RelativePose
from omnilab_appearance.common.spherical_features import check_calibrated
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.descriptors.radon_hog import RadonHog
from omnilab_appearance.loop_closures.cosine_index import CosineIndex
from omnilab_appearance.loop_closures.hog_threshold import hog_of, no_closures
from omnilab_appearance.odometries.planar_epipolar import PlanarEpipolar, propagate

EVERY = 5  # images: how often the length of a step is measured
LEAST = 0.2  # usual steps: standard deviation of a position, at least


@dataclass
class GeometricVerification:
    """Earlier images whose HOG of the Radon transform is most alike, verified by the geometry of local features.

    A candidate is verified where enough matches agree with one planar motion and their parallax is small, which distinguishes
    the same place from the same room. Rotation and direction are those of the geometry; the length is that of the ground
    plane, in usual steps, some of which are measured in the same way. Images taken shortly before are left out, and
    candidates that are much less alike than successive images.
    """

    geometry: PlanarEpipolar = field(default_factory=PlanarEpipolar)  # its matches and tolerances; not its lengths
    candidates: int = setting(3, at_least=1)  # to verify, the most alike
    alike: float = setting(5.0, above=0)  # how much further apart than usual neighbours in time candidates may be
    least: int = setting(40, at_least=4)  # matches that agree
    share: float = setting(0.4, at_least=0, at_most=1)  # of the matches that agree
    parallax_deg: float = setting(4.0, above=0, at_most=180)  # root mean square, of matches that agree: at most
    parallax_steps: float = setting(
        2.0, above=0
    )  # and at most so many times that of usual steps, near walls or far from them
    exclude: int = setting(30, at_least=1)  # images just before that are not compared with
    most: int = setting(1, at_least=1)  # closures of an image, those that moved least
    pause: int = setting(
        0, at_least=0
    )  # images after a closure that are not compared: keeps graphs of trajectories driven many times sparse
    reach: float = setting(
        1.0, at_least=1e-6, at_most=1e6
    )  # standard deviation of the position without a length of the ground plane, in usual steps
    turn_sigma_deg: float = setting(0.5, at_least=1e-6, at_most=1e6)  # and of the heading, at least
    cells: int = setting(16, at_least=1, at_most=4096)  # of the HOG
    bins: int = setting(8, at_least=1, at_most=1024)  # of the HOG
    offsets: int = setting(
        87, at_least=4, at_most=4096
    )  # of the Radon transform: the thesis's 173 take four times as long
    angles: int = setting(90, at_least=4, at_most=4096)  # of the Radon transform; the thesis has 180

    def __post_init__(self) -> None:
        check_settings(self)
        RadonHog(self.cells, self.bins, self.offsets, self.angles)

    def begin(self) -> VerifiedDatabase:
        """An empty place database."""
        return VerifiedDatabase(self)


class VerifiedClosure(NamedTuple):
    """A node at the place of an image, verified by geometry."""

    parallax_rad: float
    node: int
    motion: Floats  # (3,)
    covariance: Floats  # (3, 3)


class VerifiedDatabase:
    """Place database of HOGs and local features."""

    def __init__(self, settings: GeometricVerification) -> None:
        self._settings, self._hogs, self._rest = settings, CosineIndex(), 0
        self._features: list[ImageFeatures | None] = []  # None of what is unusable
        # each in the order of its numbers
        self._steps: list[float] = []  # distances between images that follow each other
        self._parallaxes: list[float] = []  # of some steps, root mean squares in radians
        self._heights: list[float] = []  # lengths of some steps, in heights of the camera

    def query(
        self, frames: Frames, features: ImageFeatures | Unusable | None, step: float, rng: np.random.Generator
    ) -> Closures:
        """See `omnilab.api.PlaceDatabase`."""
        s = self._settings
        own = self._extract(frames, features)
        self._add(frames, own)
        if own is None or len(self._hogs) < 2:
            return no_closures(0)
        insort(self._steps, float(self._hogs.distances(0)[-1]))
        if len(self._hogs) % EVERY == 2:  # the first step already
            self._measure_step(rng)
        if self._rest > 0:
            self._rest -= 1
            return no_closures(0)
        distances = self._hogs.distances(s.exclude)
        candidates = self._candidates(distances)
        verified = [found for node in candidates.tolist() if (found := self._verify(node, own, step, rng))]
        verified = sorted(verified, key=lambda found: found.parallax_rad)[: s.most]
        self._rest = s.pause if verified else 0
        return _closures(verified, distances, len(candidates))

    def _extract(self, frames: Frames, features: ImageFeatures | Unusable | None) -> ImageFeatures | None:
        """The image's features: those of the odometry, or else its own. Nothing that a subclass adds is kept."""
        if not isinstance(features, ImageFeatures | Unusable):
            check_calibrated(frames.camera, "loop_closure=hog_threshold")
            (features,) = self._settings.geometry.extract(frames)
        if isinstance(features, Unusable):
            return None
        return ImageFeatures(features.directions, features.azimuth_level, features.vectors)

    def _add(self, frames: Frames, features: ImageFeatures | None) -> None:
        """Append the image to the database."""
        s = self._settings
        transform = Radon(s.offsets, s.angles).describe(view_of(frames.images, frames.camera, "mirror", False)).place
        self._hogs.add(np.zeros(s.cells * s.bins) if features is None else hog_of(transform, s.cells, s.bins))
        self._features.append(features)

    def _candidates(self, distances: Floats) -> Ints:
        """The most alike nodes, of which none is much less alike than successive images."""
        s = self._settings
        likely = np.argsort(distances, kind="stable")[: s.candidates]
        return np.asarray(likely[distances[likely] <= s.alike * middle(self._steps)])

    def _measure_step(self, rng: np.random.Generator) -> None:
        """The parallax of the last step, and its length in heights of the camera above the floor."""
        before, now = self._features[-2:]
        if before is not None and now is not None:
            pose, p, q = self._settings.geometry.relative(before, now, rng)
            if not np.isnan(pose.phi):
                insort(self._parallaxes, _parallax(pose, p, q))
            if not pose.failed and not (ground := ground_step(p, q, pose.phi, pose.beta, pose.noise_rad)).failed:
                insort(self._heights, ground.length)

    def _verify(self, node: int, now: ImageFeatures, step: float, rng: np.random.Generator) -> VerifiedClosure | None:
        """The closure with a node; None unless the geometry confirms it."""
        s, before = self._settings, self._features[node]
        if before is None:
            return None
        pose, p, q = s.geometry.relative(before, now, rng)
        if np.isnan(pose.phi) or len(p) < max(s.least, s.share * len(pose.agree)):
            return None
        parallax = _parallax(pose, p, q)
        usual = middle(self._parallaxes) if self._parallaxes else np.inf
        if parallax > min(np.deg2rad(s.parallax_deg), s.parallax_steps * usual):
            return None
        motion, covariance = self._motion(pose, p, q, step)
        covariance[2, 2] += np.deg2rad(s.turn_sigma_deg) ** 2
        return VerifiedClosure(parallax, node, motion, covariance)

    def _motion(self, pose: RelativePose, p: Floats, q: Floats, step: float) -> tuple[Floats, Floats]:
        """Motion (3,) and covariance (3, 3): without a length of the ground plane, no translation, known to `reach`."""
        if not pose.failed and self._heights:
            ground = ground_step(p, q, pose.phi, pose.beta, pose.noise_rad)
            if not ground.failed:
                unit = step / middle(self._heights)
                scaled = ground._replace(length=unit * ground.length, variance=unit**2 * ground.variance)
                motion, covariance = propagate(pose, scaled)
                return motion, covariance + np.diag([(LEAST * step) ** 2] * 2 + [0.0])
        return np.array([0.0, 0.0, pose.phi]), np.diag([(self._settings.reach * step) ** 2] * 2 + [0.0])


def _closures(verified: list[VerifiedClosure], distances: Floats, candidates: int) -> Closures:
    nodes: Ints = np.array([found.node for found in verified], int)
    motions = np.array([found.motion for found in verified]).reshape(-1, 3)
    covariances = np.array([found.covariance for found in verified]).reshape(-1, 3, 3)
    return Closures(nodes, motions, covariances, distances[nodes], candidates)


def _parallax(pose: RelativePose, p: Floats, q: Floats) -> float:
    """Root mean square displacement of inliers (K, 3) besides the rotation, in radians."""
    return float(np.sqrt(np.mean((p - rotated(q, pose.phi)) ** 2) * 3))
