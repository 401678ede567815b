"""Front end of SLAM with landmarks: which features of an image show landmarks, and which become some."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, ImageFeatures, Ints, Unusable, ViewFilter, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_studies.view_slam.front_end import START_VARIANCE, FilterClock, ViewAssociation
from omnilab_studies.view_slam.repeated_observations import RepeatedObservations

LANDMARKS = "landmarks"  # what a view filter observes that declares it; others observe views


@dataclass
class LandmarkSettings:
    """Data association of landmarks: by their descriptors, then by the filter's gate (Gil et al., 2006; Civera et al., 2008)."""

    wanted: int = setting(40, at_least=1, at_most=10_000)  # landmarks in an image: with fewer, features become some
    followed: int = setting(4, at_least=1)  # images in a row in which a feature was found before it becomes one
    ratio: float = setting(0.8, above=0, at_most=1)  # a match is so much nearer than the second best
    apart_deg: float = setting(4.0, at_least=0, below=180)  # between a new landmark and those in the image
    sigma_deg: float = setting(0.5, at_least=1e-6, at_most=1e6)  # standard deviation of azimuth and elevation
    correlation_m: float = setting(
        0.0, at_least=0, at_most=1e6
    )  # integral length of a landmark's errors along the way, a radian counting as a metre; 0: they are independent

    def __post_init__(self) -> None:
        check_settings(self, "study.landmarks.")


def observes_landmarks(view_filter: ViewFilter) -> bool:
    """Whether a filter takes the directions of landmarks instead of those of views."""
    return getattr(view_filter, "observes", "views") == LANDMARKS


class LandmarkMapper:
    """One filter of landmarks along the trajectory: its map, and the descriptor by which each landmark is known again."""

    def __init__(self, view_filter: ViewFilter, settings: LandmarkSettings, first_pose: Floats) -> None:
        self.map = view_filter.begin(first_pose, START_VARIANCE * np.eye(3))
        self.images: list[int] = []  # in which each landmark was first observed
        self.poses = [self.map.pose()]
        self.clock = FilterClock(self.map)
        self._settings, self._covariance = settings, np.deg2rad(settings.sigma_deg) ** 2 * np.eye(2)
        self._repeats = RepeatedObservations(settings.correlation_m)
        self._descriptors: Floats = np.zeros((0, 0), np.float32)  # of the landmarks, as last seen
        self._before: Floats = np.zeros((0, 0), np.float32)  # descriptors of the features of the last image
        self._age: Ints = np.zeros(0, int)  # and in how many images in a row each was found

    def process(self, image: int, features: Any, motion: Floats | None, covariance: Floats | None) -> ViewAssociation:
        """One more image, after the motion (3,) of odometry with its covariance (3, 3); neither at the first."""
        self.clock.begin_image()
        warnings, timed = list[str](), self.clock.run
        if motion is not None:
            warnings += timed(self.map.predict, motion, covariance)
            self._repeats.move(motion)
        landmarks, believed = np.zeros(0, int), np.zeros(0, bool)
        angles: Floats = np.zeros((0, 2))
        if not isinstance(features, Unusable):
            directions, descriptors = _seen(features)
            landmarks, found = matched(self._descriptors, descriptors, self._settings.ratio)
            angles = directions[found]
            if len(landmarks):
                believed, more = timed(self.map.observe, landmarks, angles, self._covariances(landmarks))
                warnings += more
                self._descriptors[landmarks[believed]] = descriptors[found[believed]]
            self._follow(descriptors)
            warnings += self._take_landmarks(image, directions, descriptors, found)
        if motion is not None:
            self.poses.append(timed(self.map.pose))
        self.clock.end_image()
        return ViewAssociation(landmarks, angles, believed, {}, None, warnings)

    def _follow(self, descriptors: Floats) -> None:
        """In how many images in a row each feature was found."""
        age = np.ones(len(descriptors), int)
        before, now = matched(self._before, descriptors, self._settings.ratio)
        age[now] += self._age[before]
        self._before, self._age = descriptors, age

    def _take_landmarks(self, image: int, directions: Floats, descriptors: Floats, found: Ints) -> list[str]:
        """Features that were followed long enough become landmarks, strongest first, where none is near in the image.

        Those of the first image at once: only there the robot knows where it is.
        """
        s = self._settings
        free = np.setdiff1d(np.flatnonzero(self._age >= (s.followed if self.images else 1)), found)
        new: list[int] = []
        for feature in free:
            if len(found) + len(new) >= s.wanted:
                break
            if _apart(directions[feature], directions[[*found, *new]], np.deg2rad(s.apart_deg)):
                new.append(int(feature))
        if not new:
            return []
        numbers = np.array([self.clock.run(self.map.add_view) for _ in new])
        self.images += [image] * len(new)
        self._descriptors = np.concatenate([self._descriptors.reshape(-1, descriptors.shape[1]), descriptors[new]])
        _, warnings = self.clock.run(self.map.observe, numbers, directions[new], self._covariances(numbers))
        return list(warnings)

    def _covariances(self, landmarks: Ints) -> Floats:
        """Of one observation of each landmark (K,) now: (K, 2, 2)."""
        return np.array([self._repeats.factor(int(landmark)) * self._covariance for landmark in landmarks])


def _seen(features: Any) -> tuple[Floats, Floats]:
    """Azimuths and elevations (F, 2) of an image's features, and their descriptors (F, D) of unit length."""
    if not isinstance(features, ImageFeatures) or features.directions is None:
        raise ConfigError(
            "landmarks are local features of a calibrated camera, and odometries.views extracts others; give"
            " +odometry@odometries.views=planar_epipolar, or leave out the filters that observe landmarks"
        )
    x, y, z = np.asarray(features.directions, float).T
    vectors = np.asarray(features.vectors, np.float32)
    lengths = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]), np.asarray(vectors / lengths)


def matched(known: Floats, descriptors: Floats, ratio: float) -> tuple[Ints, Ints]:
    """Pairs (M,), (M,) of known descriptors (N, D) and an image's (F, D): nearest to each other, and clearly so.

    Clearly: by the ratio to the second best of the image's (Lowe, 2004); of two landmarks of one point both would fail the other way.
    """
    if len(known) == 0 or len(descriptors) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    cosine, rows = known @ descriptors.T, np.arange(len(known))
    best = cosine.argmax(axis=1)
    distance2 = 1 - cosine[rows, best]
    mutual = cosine.argmax(axis=0)[best] == rows
    cosine[rows, best] = -2
    clear: Bools = distance2 < ratio**2 * (1 - cosine.max(axis=1))
    chosen = np.flatnonzero(mutual & clear)
    return chosen, best[chosen]


def _apart(direction: Floats, others: Floats, angle_rad: float) -> bool:
    """Whether a direction (2,), azimuth and elevation, is farther from all others (K, 2) than an angle."""
    azimuth, elevation = others.T
    cosine = np.sin(elevation) * np.sin(direction[1])
    cosine += np.cos(elevation) * np.cos(direction[1]) * np.cos(azimuth - direction[0])
    return bool((cosine < np.cos(angle_rad)).all())
