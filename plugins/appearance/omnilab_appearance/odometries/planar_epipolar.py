"""Odometry from the epipolar geometry of planar motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from omnilab.api import (
    Bytes,
    CalibratedCamera,
    Floats,
    Frames,
    ImageFeatures,
    Ints,
    Motion,
    Signatures,
    Unusable,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError
from omnilab.image import to_gray, view_of
from omnilab_appearance.common.feature_surfaces import FeatureSurface, surface_features
from omnilab_appearance.common.ground_scale import GroundStep, ground_step
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.relative_pose import CORRELATED, RelativePose, Solver, pose_of
from omnilab_appearance.common.spherical_features import (
    MOST_ROWS,
    check_calibrated,
    directions_of,
    match_features,
    spherical_features,
)
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.distances.poc_squared import PocSquared
from omnilab_appearance.odometries.floor_image import floor_pictures, floor_step

UNIT_STEP = GroundStep(1.0, 1.0, 0)  # where nothing is known of a length but that there is one
POC_SPREAD = 0.25  # standard deviation of a length by POC, of the length


class Length(Enum):
    """What the length of a translation is estimated from."""

    floor = "floor"
    floor_image = "floor_image"
    poc = "poc"
    unit = "unit"


@dataclass(frozen=True, eq=False)
class RadonFeatures(ImageFeatures):
    """Local features of an image, and its Radon transform, which lengths are estimated from."""

    radon: Floats  # (offsets, angles) of the mirror image


@dataclass(frozen=True, eq=False)
class FloorFeatures(ImageFeatures):
    """Local features of an image, and the floor as seen from above, which lengths are estimated from."""

    floor: Bytes  # (S, S)


@dataclass
class PlanarEpipolar:
    """Rotation and direction from matched features on the unit sphere (view-based SLAM, 3.2), the length by the floor.

    Features are found on the panorama and matched; planar motion has two unknowns up to scale, which RANSAC finds from
    two matches, or from four by the linear equations as printed, and Gauss-Newton refines with their covariance. The
    length is that of matched points of the floor, in heights of the camera above it (metres with `height_m`), or that of
    the floor's pictures, which takes a sharp camera and finds faint textures (`floor_image`), or the squared POC distance
    of the Radon transforms (Berenguer, thesis, eq. 6.4-6.5), in its own unit.

    The panorama has the camera's own resolution: `omnilab.image.panorama_shape`. Fewer `panorama_rows` save time, and
    more `features` match images farther apart.
    """

    detector: Detector = Detector.fast_sift  # plain_sift: half the time, less precise; sift: OpenCV's; or surf
    features: int = setting(500, at_least=1, at_most=10_000)  # at most so many of each image
    surface: FeatureSurface = (
        FeatureSurface.panorama
    )  # on which they are found; or image, the camera's own, or tiles of the sphere
    panorama_rows: int | None = setting(
        None, at_least=32, at_most=MOST_ROWS
    )  # of the panorama that they are found on, 4 columns each; not given: the camera's own resolution
    upright: bool = False  # described along the panorama's axes, not along an orientation of their own; of SIFT
    ratio: float = setting(0.8, above=0, at_most=1)  # a match is so much nearer than the second best
    solver: Solver = Solver.two_point  # minimal; or linear, on four points as printed
    tolerance_deg: float = setting(0.5, above=0, at_most=10)  # of a match from its epipolar plane
    draws: int = setting(300, at_least=1, at_most=1_000_000)  # of RANSAC, at most
    least_matches: int = setting(12, at_least=5)  # inliers; with fewer the estimate fails
    length: Length = (
        Length.floor
    )  # by points of the floor; floor_image: by its pictures; poc, by the Radon transforms; unit: 1
    height_m: float | None = setting(None, above=0)  # of the camera above the floor; not given: lengths in that height

    def __post_init__(self) -> None:
        check_settings(self)
        if self.upright and self.detector is Detector.surf:
            raise ConfigError("upright=true is for detector=sift, not surf; give upright=false, or sift")
        if self.panorama_rows is not None and self.surface is not FeatureSurface.panorama:
            raise ConfigError(
                f"panorama_rows={self.panorama_rows} is no size of surface={self.surface.value}; leave one out"
            )
        if self.upright and self.surface is not FeatureSurface.panorama:
            raise ConfigError(
                f"upright=true is for surface=panorama, not {self.surface.value}; give upright=false, or panorama"
            )

    def extract(self, frames: Frames) -> Sequence[ImageFeatures | Unusable]:
        """Features of each image on the unit sphere; DataError for an uncalibrated camera."""
        check_calibrated(frames.camera, "odometry=appearance")
        found = self._features(frames)
        if self.length is Length.floor_image:
            return self._with_floor(frames, found)
        if self.length is not Length.poc:
            return found
        transforms = Radon().describe(view_of(frames.images, frames.camera, "mirror", False)).place
        return [
            f if isinstance(f, Unusable) else RadonFeatures(f.directions, f.azimuth_level, f.vectors, transform)
            for f, transform in zip(found, transforms, strict=True)
        ]

    def _with_floor(self, frames: Frames, found: list[ImageFeatures | Unusable]) -> list[ImageFeatures | Unusable]:
        assert isinstance(frames.camera, CalibratedCamera)
        return [
            f if isinstance(f, Unusable) else FloorFeatures(f.directions, f.azimuth_level, f.vectors, floor)
            for f, floor in zip(found, floor_pictures(to_gray(frames.images), frames.camera), strict=True)
        ]

    def _features(self, frames: Frames) -> list[ImageFeatures | Unusable]:
        if self.surface is FeatureSurface.panorama:
            return spherical_features(
                frames, self.detector, self.features, self.least_matches, self.panorama_rows, self.upright
            )
        return surface_features(frames, self.surface, self.detector, self.features, self.least_matches)

    def estimate(self, before: ImageFeatures, now: ImageFeatures, rng: np.random.Generator) -> Motion:
        """The motion between two images of one camera, from their features."""
        i, j, pose = self._matched(before, now, rng)
        if pose.failed:
            return self._motion(before, now, i, j, pose, GroundStep(np.nan, np.inf, 0, pose.failed))
        if self.length is Length.unit:
            return self._motion(before, now, i, j, pose, UNIT_STEP)
        if self.length is Length.poc:
            return self._motion(before, now, i, j, pose, _poc_step(before, now))
        if self.length is Length.floor_image:
            step = _floor_step(before, now, pose)
        else:
            p, q = directions_of(before)[i], directions_of(now)[j]
            step = ground_step(p[pose.agree], q[pose.agree], pose.phi, pose.beta, pose.noise_rad)
        height = self.height_m or 1.0
        scaled = step._replace(length=height * step.length, variance=height**2 * step.variance)
        return self._motion(before, now, i, j, pose, scaled)

    def relative(
        self, before: ImageFeatures, now: ImageFeatures, rng: np.random.Generator
    ) -> tuple[RelativePose, Floats, Floats]:
        """The relative pose, and the directions (K, 3) of its inliers before and now."""
        i, j, pose = self._matched(before, now, rng)
        return pose, directions_of(before)[i[pose.agree]], directions_of(now)[j[pose.agree]]

    def _matched(
        self, before: ImageFeatures, now: ImageFeatures, rng: np.random.Generator
    ) -> tuple[Ints, Ints, RelativePose]:
        """Indices (M,), (M,) of matched features, and the relative pose that they agree on."""
        i, j = match_features(before, now, self.ratio)
        return i, j, self._pose_of(before, now, i, j, rng)

    def _pose_of(
        self, before: ImageFeatures, now: ImageFeatures, i: Ints, j: Ints, rng: np.random.Generator
    ) -> RelativePose:
        p, q = directions_of(before)[i], directions_of(now)[j]
        return pose_of(p, q, rng, self.solver, self.tolerance_deg, self.draws, self.least_matches, CORRELATED)

    def _motion(
        self, before: ImageFeatures, now: ImageFeatures, i: Ints, j: Ints, pose: RelativePose, step: GroundStep
    ) -> Motion:
        vector, covariance = propagate(pose, step)
        matches = np.stack([before.azimuth_level[i], now.azimuth_level[j]], axis=1)
        features = len(before.azimuth_level) + len(now.azimuth_level)
        return Motion(vector, covariance, self._unit, step.failed, matches, pose.agree, features)

    @property
    def _unit(self) -> str:
        if self.length not in {Length.floor, Length.floor_image}:
            return "1"
        return "camera heights" if self.height_m is None else "m"


def _floor_step(before: ImageFeatures, now: ImageFeatures, pose: RelativePose) -> GroundStep:
    if not (isinstance(before, FloorFeatures) and isinstance(now, FloorFeatures)):
        raise ConfigError("length=floor_image was given features that were extracted with another; use one for both")
    return floor_step(before.floor, now.floor, pose.phi, pose.beta)


def _poc_step(before: ImageFeatures, now: ImageFeatures) -> GroundStep:
    if not (isinstance(before, RadonFeatures) and isinstance(now, RadonFeatures)):
        raise ConfigError("length=poc was given features that were extracted with length=floor; use one for both")
    places = Signatures(before.radon[None])
    distance = float(PocSquared().match(Signatures(now.radon[None]), PocSquared().prepare(places)).distance[0, 0])
    return GroundStep(distance, (POC_SPREAD * distance) ** 2, 0)


def propagate(pose: RelativePose, step: GroundStep) -> tuple[Floats, Floats]:
    """x, y and heading (3,), NaN where their estimate failed, and their covariance (3, 3), infinite there."""
    c, s, d = np.cos(pose.beta), np.sin(pose.beta), step.length
    vector = np.array([d * c, d * s, pose.phi])
    if step.failed:
        known = np.isfinite(pose.phi)
        return vector, np.diag([np.inf, np.inf, pose.covariance[0, 0] if known else np.inf])
    J = np.array([[c, -d * s, 0], [s, d * c, 0], [0, 0, 1]])  # by length, direction, heading
    inner = np.zeros((3, 3))
    inner[0, 0] = step.variance
    inner[1:, 1:] = pose.covariance[::-1, ::-1]
    return vector, J @ inner @ J.T
