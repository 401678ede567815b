"""View-based SLAM from images (Gil et al., 2012, 5.2): several filters on one trajectory, compared with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import ClassVar

import numpy as np

from omnilab.api import Floats, Parts, PathPoses, Plan, Recorder, Report, ViewFilter, check_settings, setting
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab.posegraph.graph import vectors
from omnilab_studies.common.live.pacing import PacedFrames, ReplayPace, WhenLate
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.pose_sources import Source, check_is_trajectory, plan_of_trajectory
from omnilab_studies.common.samples import evenly
from omnilab_studies.view_slam.display import TRUTH, line
from omnilab_studies.view_slam.filter_comparison import filters_of
from omnilab_studies.view_slam.front_end import AssociationSettings
from omnilab_studies.view_slam.landmark_front_end import LandmarkSettings, observes_landmarks
from omnilab_studies.view_slam.layout import VIEW_SLAM
from omnilab_studies.view_slam.mapping_run import VIEWS, ViewMappingRun
from omnilab_studies.view_slam.results import report
from omnilab_studies.view_slam.saved_views import ViewWriter, check_sensors
from omnilab_studies.view_slam.wall_lines import wall_lines

FINE = 40  # samples of each step of a path, to space images along it
MOST_IMAGES = 1_000_000  # of a path: more would take a day and more


@dataclass
class ViewSlam:
    """View-based SLAM (Gil et al., 2012, 5.2): each of the `view_filters` maps views from the same images and odometry.

    The run's `odometry` predicts; `odometries.views` estimates the relative pose of two images, of which the bearing and the
    relative orientation of a view are taken. An image that shows no view well enough becomes one. Poses must be known:
    errors are measured against them, and the maps begin at the first.

    Views from before, with their poses, come from `sensors.known`: those that a run kept, or any images of the same
    camera. Their errors are taken as independent, with `known_sigma_m` in x and y and `known_sigma_deg` in heading.
    """

    images: Source = Source.path  # or recorded: all that was recorded, in its order
    path: str = "two_rooms"  # of the world, by its name; or a file of poses (.txt, .tum: TUM's format; .csv)
    every_m: float = setting(0.05, above=0)  # an image on a path so often
    every_rad: float = setting(0.05, above=0)  # and whenever the robot has rotated so far
    height_m: float | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # of the viewpoint on a path of the world; null: the sensor's own
    keep: str | None = setting(
        None, writes=True
    )  # folder for the first filter's views: images, and the poses that they were mapped at
    known_sigma_m: float = setting(
        0.05, at_least=1e-6, at_most=1e6
    )  # standard deviation of x and y of views from before
    known_sigma_deg: float = setting(1.0, at_least=1e-6, at_most=1e6)  # and of their headings
    views: AssociationSettings = field(
        default_factory=AssociationSettings
    )  # when an image shows a view, and when it becomes one
    landmarks: LandmarkSettings = field(default_factory=LandmarkSettings)  # for filters that observe landmarks
    pace: ReplayPace = ReplayPace.fast  # fast, or recorded: images come at their own times
    when_late: WhenLate = WhenLate.queue  # images that come while others are mapped: queue, or drop all but the newest
    waiting: int = setting(20, at_least=1, at_most=10_000)  # images at most that wait, with when_late=queue
    show: int = setting(
        150, at_least=1
    )  # images that go into the logs, and stages of the map; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometry")
    metric_names: ClassVar[tuple[str, ...]] = (
        "FILTER_rms", "FILTER_end", "FILTER_final_rms", "FILTER_heading_rms", "FILTER_nees", "FILTER_nees_median",
        "FILTER_nees_within", "FILTER_views", "FILTER_observed", "FILTER_gated", "odometry_rms", "images",
        "path_length", "lost_steps", "known_views", "FILTER_variables",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_is_trajectory(self.images)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map image by image with every filter; evaluate."""
        filters = filters_of(parts)
        if VIEWS not in parts.odometries:
            raise ConfigError("this study needs to relate two images; give +odometry@odometries.views=planar_epipolar")
        check_sensors(parts)
        self._check_landmarks(filters, parts)
        plan = self.planned(parts)
        _log_truth(record, parts, plan)
        seed, mapping_seed = int(rng.integers(2**32)), int(rng.integers(2**32))
        writer = None if self.keep is None else ViewWriter(self.keep, parts, plan, seed, asdict(self) | {"keep": None})
        shown = set(evenly(len(plan), self.show).tolist())
        mapping = ViewMappingRun(
            parts, filters, self.views, self.landmarks, self._known_covariance(), mapping_seed, record, shown, writer
        )
        frames = PacedFrames(self.pace, self.when_late, self.waiting)
        for arrived in frames.of(parts, plan, record, seed):
            with frames.answering(arrived, record):
                mapping.process(arrived.frame)
        frames.log(record)
        if len(mapping.truth) < 2:
            raise DataError(f"a sequence of {len(mapping.truth)} image makes no trajectory; give 2 or more")
        if writer:
            writer.close(next(iter(mapping.mappers.values())).map.views())
        assert plan.T_world_camera is not None
        found = report(mapping, wall_lines(parts.sensor.scene(), float(plan.T_world_camera[0, 2, 3])), record)
        return replace(found, tables={**found.tables, **frames.tables()})

    def _check_landmarks(self, filters: Mapping[str, ViewFilter], parts: Parts) -> None:
        """ConfigError where a filter that observes landmarks would be given views."""
        first = next(iter(filters))
        for name in (name for name, view_filter in filters.items() if observes_landmarks(view_filter)):
            if parts.sensors:
                raise ConfigError(
                    f"view_filters.{name} observes landmarks and cannot know views from before; leave out"
                    f" {', '.join(f'sensors.{sensor}' for sensor in parts.sensors)}, or ~view_filters.{name}"
                )
            if self.keep is not None and name == first:
                raise ConfigError(
                    f"study.keep={self.keep} keeps the views of the first filter, and view_filters.{name} has landmarks;"
                    " leave it out, or name a filter of views first"
                )

    def planned(self, parts: Parts) -> Plan:
        """The images of the trajectory, in their order."""
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        if self.images is Source.path and plan.T_world_camera is not None and len(plan) > 1:
            plan = parts.sensor.plan(PathPoses(spaced(plan.T_world_camera, self.every_m, self.every_rad)))
        if plan.T_world_camera is None:
            raise DataError(
                "the images have no poses, and view_slam measures its maps with them; give the sensor poses"
            )
        if len(plan) < 2:
            raise DataError(f"a sequence of {len(plan)} image makes no trajectory; give 2 or more")
        return plan

    def _known_covariance(self) -> Floats:
        """The covariance (3, 3) of the poses of views from before."""
        sigmas = [self.known_sigma_m, self.known_sigma_m, np.deg2rad(self.known_sigma_deg)]
        return np.asarray(np.diag(sigmas) ** 2)


def _log_truth(record: Recorder, parts: Parts, plan: Plan) -> None:
    """The layout, the world's surface, and the true trajectory."""
    start_logs(record, VIEW_SLAM, parts.sensor)
    assert plan.T_world_camera is not None
    record.log("truth", line(vectors(plan.T_world_camera, planar=True), TRUTH))


def spaced(T_world_camera: Floats, every_m: float, every_rad: float) -> Floats:
    """Poses (M, 4, 4) along a path (N, 4, 4), a next one wherever the robot has moved or rotated so far.

    ConfigError for more than MOST_IMAGES.
    """
    count = len(T_world_camera)
    at = np.linspace(0, count - 1, FINE * (count - 1) + 1)
    number = np.arange(count)
    position = np.column_stack([np.interp(at, number, axis) for axis in T_world_camera[:, :3, 3].T])
    heading = np.interp(at, number, np.unwrap(heading_of(T_world_camera)))
    with np.errstate(over="ignore"):  # told below
        moves = np.linalg.norm(np.diff(position, axis=0), axis=1) / every_m
        along = np.append(0.0, np.cumsum(np.maximum(moves, np.abs(np.diff(heading)) / every_rad)))
    if not along[-1] < MOST_IMAGES:
        raise ConfigError(
            f"study.every_m={every_m} and study.every_rad={every_rad} ask for more than {MOST_IMAGES} images on this path;"
            " give larger ones"
        )
    chosen = np.searchsorted(along, np.arange(int(along[-1] + 1e-9) + 1) - 1e-9)
    return planar_poses(position[chosen], heading[chosen])
