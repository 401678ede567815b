"""Front end of view-based SLAM: which views an image shows, and when it becomes a new one (Gil et al., 2012, 4)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints, Motion, Unusable, ViewFilter, ViewMap, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_studies.view_slam.initialisation import Initialisation, expected_gain
from omnilab_studies.view_slam.repeated_observations import RepeatedObservations

START_VARIANCE = 1e-6  # m², rad²: the first pose is known
FINEST = 1e-9  # m², rad²: added to odometry's covariance, should that be nothing
RelativePose = Callable[[int, int], Motion]  # the motion from one image to another, by their numbers


@dataclass
class AssociationSettings:
    """Data association: when an image shows a view, and when it becomes one (Gil et al., 2012, 4, eq. 13 and 21)."""

    range_m: float = setting(2.0, above=0)  # delta_D: views farther from the estimated pose are no candidates
    nearest_m: float = setting(0.25, at_least=0)  # nearer ones are not observed: their bearing is hardly defined
    candidates: int = setting(
        3, at_least=1
    )  # views that an image is matched with, at most: the nearest, and those that can be observed
    similarity: float = setting(
        0.5, above=0, at_most=1
    )  # R: an image that is less similar to all of them becomes a view
    initialisation: Initialisation = Initialisation.similarity  # as printed; or information
    least_gain: float = setting(1.0, above=0)  # of information: nats that an image is expected to tell to become a view
    ahead_m: float = setting(1.0, above=0)  # about the pose that the robot has so far ahead
    least: int = setting(25, at_least=4)  # inliers of the matches, or a view is not observed
    sigma_deg: float = setting(
        0.5, at_least=1e-6, at_most=1e6
    )  # standard deviation of both angles besides that of the matches
    covariance_scale: float = setting(1.0, above=0, at_most=1e6)  # factor on the covariance of the matches
    correlation_m: float = setting(
        0.0, at_least=0, at_most=1e6
    )  # integral length of the errors of a view's angles along the way, a radian counting as a metre; 0: they are independent

    def __post_init__(self) -> None:
        check_settings(self, "study.views.")
        if not 0 <= self.nearest_m < self.range_m:
            raise ConfigError(
                f"study.views.nearest_m={self.nearest_m:g}, range_m={self.range_m:g} leave no view to be seen; give 0 or more,"
                " and a larger range"
            )


class ViewAssociation(NamedTuple):
    """The views that one image was associated with."""

    views: Ints  # (K,) that it observed
    angles_rad: Floats  # (K, 2) bearing and relative orientation
    believed: Bools  # (K,) which of them the filter took
    candidates: dict[int, Motion]  # views that the image was matched with
    new: int | None  # the view that it became
    warnings: list[str]


class FilterClock:
    """Processor time of a filter for each image, and how many variables it estimates after it.

    Of its own thread, so that other processes do not count; threads of a numeric library do not, either.
    """

    def __init__(self, view_map: ViewMap) -> None:
        self.seconds: list[float] = []
        self.variables: list[int] = []  # none of a map that does not say
        self._map = view_map

    def begin_image(self) -> None:
        """What follows is about the next image."""
        self.seconds.append(0.0)

    def run(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """A call of the map's, timed."""
        start = time.thread_time()
        found = method(*arguments)
        self.seconds[-1] += time.thread_time() - start
        return found

    def end_image(self) -> None:
        """The image is mapped."""
        if (count := getattr(self._map, "variables", None)) is not None:
            self.variables.append(int(count))


class ViewMapper:
    """One filter along the trajectory: its map, and which image each of its views is."""

    def __init__(
        self, view_filter: ViewFilter, settings: AssociationSettings, relative_pose: RelativePose, first_pose: Floats
    ) -> None:
        self.map = view_filter.begin(first_pose, START_VARIANCE * np.eye(3))
        self.images: list[int] = []  # of each view
        self.poses = [self.map.pose()]
        self.clock = FilterClock(self.map)
        self._settings, self._relative_pose = settings, relative_pose
        self._drift, self._driven_m = np.zeros((3, 3)), 0.0  # covariances of odometry so far, and its way
        self._repeats = RepeatedObservations(settings.correlation_m)

    def know_view(self, image: int, pose: Floats, covariance: Floats) -> None:
        """A view from before, at a pose (3,) known with a covariance (3, 3)."""
        self.map.know_view(pose, covariance)
        self.images.append(image)

    def process(self, image: int, features: Any, motion: Floats | None, covariance: Floats | None) -> ViewAssociation:
        """One more image, after the motion (3,) of odometry with its covariance (3, 3); neither at the first."""
        self.clock.begin_image()
        warnings, timed = list[str](), self.clock.run
        if motion is not None:
            warnings += timed(self.map.predict, motion, covariance)
            self._repeats.move(motion)
        if motion is not None and covariance is not None and not warnings:
            self._drift, self._driven_m = self._drift + covariance, self._driven_m + float(np.hypot(*motion[:2]))
        distance_m = np.linalg.norm(self.map.views()[:, :2] - self.map.pose()[0][:2], axis=1)
        candidates = {} if isinstance(features, Unusable) else self._match_candidates(image, distance_m)
        views, angles, covariances = self._observations(candidates, distance_m)
        believed = np.zeros(0, bool)
        if len(views):
            believed, more = timed(self.map.observe, views, angles, covariances)
            warnings += more
        new = None
        if not isinstance(features, Unusable) and self._becomes_view(candidates, views, covariances):
            new = timed(self.map.add_view)
            self.images.append(image)
        if motion is not None:
            self.poses.append(timed(self.map.pose))
        self.clock.end_image()
        return ViewAssociation(views, angles, believed, candidates, new, warnings)

    def _becomes_view(self, candidates: dict[int, Motion], views: Ints, covariances: Floats) -> bool:
        """Whether the present image does, by the views (K,) that it observed with covariances (K, 2, 2)."""
        s = self._settings
        if s.initialisation is Initialisation.similarity:
            return max((similarity(relative) for relative in candidates.values()), default=0.0) < s.similarity
        poses, (robot, _) = self.map.views(), self.map.pose()
        if not len(poses):
            return True
        if np.linalg.norm(poses[:, :2] - robot[:2], axis=1).min() < s.nearest_m:
            return False  # it could not be observed from where another one can
        c, si = np.cos(robot[2]), np.sin(robot[2])
        offsets_m = (poses[views, :2] - robot[:2]) @ np.array([[c, -si], [si, c]])
        drift = s.ahead_m * self._drift / max(self._driven_m, 1e-9) + FINEST * np.eye(3)
        return expected_gain(offsets_m, covariances, drift, np.deg2rad(s.sigma_deg), s.ahead_m) > s.least_gain

    def _match_candidates(self, image: int, distance_m: Floats) -> dict[int, Motion]:
        """The relative pose of the image and each of the nearest views within the range, by distances of views (V,).

        Of those that are too near to be observed only the nearest, which decides whether the image becomes a view.
        """
        s, order = self._settings, np.argsort(distance_m, kind="stable")
        useful = (distance_m[order] <= s.range_m) & ((distance_m[order] >= s.nearest_m) | (np.arange(len(order)) == 0))
        return {int(view): self._relative_pose(image, self.images[view]) for view in order[useful][: s.candidates]}

    def _observations(self, candidates: dict[int, Motion], distance_m: Floats) -> tuple[Ints, Floats, Floats]:
        """Views (K,) that have enough inliers, their angles (K, 2) and covariances (K, 2, 2)."""
        s, found = self._settings, []
        for view, motion in candidates.items():
            if not motion.failed and inlier_count(motion) >= s.least and distance_m[view] >= s.nearest_m:
                angles, covariance = angles_of(motion, np.deg2rad(s.sigma_deg), s.covariance_scale)
                found.append((view, angles, self._repeats.factor(view) * covariance))
        return (
            np.array([view for view, _, _ in found], int),
            np.array([angles for _, angles, _ in found]).reshape(-1, 2),
            np.array([covariance for _, _, covariance in found]).reshape(-1, 2, 2),
        )


def similarity(motion: Motion) -> float:
    """R = 2 K / (n_A + n_B): inliers of the matches, over features in both images (Gil et al., eq. 13)."""
    return 2 * inlier_count(motion) / motion.features if motion.features else 0.0


def inlier_count(motion: Motion) -> int:
    """How many matches are inliers of a motion."""
    return 0 if motion.agree is None else int(motion.agree.sum())


def angles_of(motion: Motion, sigma_rad: float, scale: float = 1.0) -> tuple[Floats, Floats]:
    """Bearing and relative orientation (2,) of the second pose of a motion, and their covariance (2, 2): that of the motion
    times a scale, and sigma besides."""
    x, y, rotation = motion.vector
    J = np.array([[-y, x, 0], [0, 0, x * x + y * y]]) / (x * x + y * y)
    return np.array([np.arctan2(y, x), rotation]), scale * (J @ motion.covariance @ J.T) + sigma_rad**2 * np.eye(2)
