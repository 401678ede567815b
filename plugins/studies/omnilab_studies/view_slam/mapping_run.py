"""Mapping run: the images of a trajectory go through the front end of every view filter, and the first one's map into the logs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Image, Motion, Odometry, Parts, Recorder, Tick, Unusable, ViewFilter
from omnilab.image import panorama
from omnilab.posegraph.graph import moved, vectors
from omnilab_studies.common.match_images import draw_image_pair
from omnilab_studies.view_slam.display import ODOMETRY, Bearings, line, show_step
from omnilab_studies.view_slam.filter_comparison import LogLimiter
from omnilab_studies.view_slam.front_end import AssociationSettings, ViewAssociation, ViewMapper, inlier_count
from omnilab_studies.view_slam.landmark_front_end import LandmarkMapper, LandmarkSettings, observes_landmarks
from omnilab_studies.view_slam.saved_views import ViewWriter, known_views

VIEWS = "views"  # the odometry that estimates the relative pose of two images
FAILED = np.diag([0.2, 0.2, 0.5]) ** 2  # m², rad²: covariance of a step whose odometry failed


class OdometryStep(NamedTuple):
    """The motion (3,) of a robot since the last image, its covariance (3, 3), and why odometry failed, if it did."""

    vector: Floats
    covariance: Floats
    failed: str = ""


def odometry_step(odometry: Odometry, before: Any, features: Any, rng: np.random.Generator) -> OdometryStep:
    """The step between what odometry extracted of two images; none, with a large covariance, where it fails.

    Without an image before, none whose covariance nobody needs.
    """
    if before is None:
        return OdometryStep(np.zeros(3), np.eye(3))
    why = next((each.reason for each in (features, before) if isinstance(each, Unusable)), "")
    if not why:
        motion = odometry.estimate(before, features, rng)
        if not motion.failed:
            return OdometryStep(motion.vector, motion.covariance)
        why = motion.failed
    return OdometryStep(np.zeros(3), FAILED, why)


class ViewMappingRun:
    """The images so far, and each filter's map of views.

    `known_covariance` (3, 3) is that of the poses of views from before, `seed` that of odometry and of relative poses,
    `shown` the images that go into the logs.
    """

    def __init__(
        self, parts: Parts, filters: Mapping[str, ViewFilter], association: AssociationSettings,
        landmarks: LandmarkSettings, known_covariance: Floats, seed: int, record: Recorder, shown: set[int],
        writer: ViewWriter | None,
    ) -> None:  # fmt: skip
        self._parts, self._filters, self._record = parts, filters, record
        self._association, self._landmarks = association, landmarks
        self._known_covariance, self._seed, self._shown, self._writer = known_covariance, seed, shown, writer
        self._rng = np.random.default_rng(seed)  # of odometry
        self._odometry_features: Any = None  # of the last image
        self._features: dict[int, Any] = {}  # of views and the present image, by number; views from before are below 0
        self._relative_poses: dict[tuple[int, int], Motion] = {}  # of the present image, for all filters
        self._panoramas: dict[int, Bytes] = {}  # of the views of the first filter, which is shown
        self._limiter = LogLimiter(record)
        self.mappers: dict[str, ViewMapper | LandmarkMapper] = {}
        self.associations: dict[str, list[ViewAssociation]] = {name: [] for name in filters}
        self.odometry: list[Floats] = []
        self.truth: list[Floats] = []
        self.keys: list[str] = []
        self.stamps_ns: list[int] = []
        self.failed_steps = 0  # of odometry
        self.known = 0  # views from before

    def process(self, frame: Frames) -> None:
        """Map one more image, a batch of one, with every filter."""
        assert frame.T_world_camera is not None
        image = len(self.truth)
        self.truth.append(vectors(frame.T_world_camera, planar=True)[0])
        self.keys.append(frame.keys[0])
        self.stamps_ns.append(int(frame.stamps_ns[0]))
        with self._record.timed("odometry"):
            motion = self._motion(frame)
        with self._record.timed("extract"):
            (features,) = self._parts.odometries[VIEWS].extract(frame)
        if isinstance(features, Unusable):
            self._limiter.log(f"image {image}, {frame.keys[0]}", [features.reason])
        self._features[image] = features
        if image == 0:
            self._begin(frame)
        else:
            self.odometry.append(moved(self.odometry[-1], motion[0]))
        self._map(image, features, (None, None) if image == 0 else motion)
        self._keep_views(frame, image)
        if image in self._shown:
            self._show(frame, image)

    def _begin(self, first: Frames) -> None:
        """Maps of nothing but views from before."""
        start = self.truth[0]
        self.odometry.append(start)
        self.mappers = {name: self._mapper(view_filter, start) for name, view_filter in self._filters.items()}
        for frame in known_views(self._parts, first.camera, self._record):
            self._add_known_view(frame)

    def _mapper(self, view_filter: ViewFilter, start: Floats) -> ViewMapper | LandmarkMapper:
        """The front end of a filter, of what it observes."""
        if observes_landmarks(view_filter):
            return LandmarkMapper(view_filter, self._landmarks, start)
        return ViewMapper(view_filter, self._association, self._relative_pose, start)

    def _add_known_view(self, frame: Frames) -> None:
        """A view from before, a batch of one, into every filter's map."""
        assert frame.T_world_camera is not None
        (features,) = self._parts.odometries[VIEWS].extract(frame)
        if isinstance(features, Unusable):
            self._limiter.log(f"known view {frame.keys[0]}", [features.reason])
            return
        self.known += 1
        self._features[-self.known] = features
        self._panoramas[-self.known] = panorama(frame.images, frame.camera)[0]
        for mapper in self._view_mappers():
            mapper.know_view(-self.known, vectors(frame.T_world_camera, planar=True)[0], self._known_covariance)
        if self._writer:
            self._writer.add(frame, self._record)

    def _motion(self, frame: Frames) -> tuple[Floats, Floats]:
        """Odometry (3,) since the last image with its covariance (3, 3); zero with a large one where it fails."""
        (features,) = self._parts.odometry.extract(frame)
        before, self._odometry_features = self._odometry_features, features
        step = odometry_step(self._parts.odometry, before, features, self._rng)
        if step.failed:
            self.failed_steps += 1
            self._limiter.log(f"image {len(self.truth) - 1}, odometry", [step.failed])
        return step.vector, step.covariance

    def _relative_pose(self, image: int, view: int) -> Motion:
        """The motion from an image to that of a view: the same whatever else is queried."""
        if (image, view) not in self._relative_poses:
            odometry, rng = self._parts.odometries[VIEWS], np.random.default_rng([self._seed, image, view % 2**32])
            with self._record.timed("relate"):
                motion = odometry.estimate(self._features[image], self._features[view], rng)
            self._relative_poses[image, view] = motion
        return self._relative_poses[image, view]

    def _map(self, image: int, features: Any, motion: tuple[Floats | None, Floats | None]) -> None:
        """The image into every filter's map, after a motion (3,) with its covariance (3, 3)."""
        self._relative_poses.clear()
        for name, mapper in self.mappers.items():
            with self._record.timed(f"map: {name}"):
                association = mapper.process(image, features, *motion)
            self.associations[name].append(association)
            self._limiter.log(f"image {image}, {name}", association.warnings)

    def _keep_views(self, frame: Frames, image: int) -> None:
        """Panorama and data set of the first filter's new view; features only of images that became a view."""
        if next(iter(self.associations.values()))[-1].new is not None:
            self._panoramas[image] = panorama(frame.images, frame.camera)[0]
            if self._writer:
                self._writer.add(frame, self._record)
        if not any(mapper.images and mapper.images[-1] == image for mapper in self._view_mappers()):
            del self._features[image]

    def _view_mappers(self) -> list[ViewMapper]:
        """The front ends that observe views."""
        return [mapper for mapper in self.mappers.values() if isinstance(mapper, ViewMapper)]

    def _show(self, frame: Frames, image: int) -> None:
        """The first filter's map into the logs, and the image above the view with most inliers."""
        name, mapper = next(iter(self.mappers.items()))
        tick, association = Tick(image, self.stamps_ns[-1]), self.associations[name][-1]
        candidates = association.candidates
        trajectory = np.array([pose for pose, _ in mapper.poses])
        views = (mapper.map.views(), mapper.map.view_covariances())
        observed = Bearings(association.views, association.angles_rad[:, 0], association.believed)
        show_step(self._record, tick, trajectory, views, np.array(list(candidates), int), observed)
        self._record.log("query/image", Image(frame.images[0]), tick)
        self._record.log("odometry", line(np.array(self.odometry), ODOMETRY), tick)
        now = panorama(frame.images, frame.camera)[0]
        best = max(candidates, key=lambda view: inlier_count(candidates[view]), default=None)
        if best is None:
            pair = draw_image_pair(now, None, None)
        else:
            pair = draw_image_pair(now, self._panoramas[mapper.images[best]], candidates[best])
        self._record.log("query/panorama", Image(pair), tick)
