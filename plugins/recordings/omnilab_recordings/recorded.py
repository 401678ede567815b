"""Recorded odometry: poses of a file, interpolated at the images' stamps."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Frames, Ints, Motion, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.posegraph.graph import inverse, vectors
from omnilab.trajectory import clocks, plausibility
from omnilab.trajectory.files import read_trajectory
from omnilab_recordings.bags.camera_poses import trajectory_of

log = logging.getLogger("omnilab")


class Reading(NamedTuple):
    """Where the wheels were when an image was taken."""

    pose: Floats  # (3,) x, y in metres and heading, in a frame that drifts; NaN where the file does not say


class _Record(NamedTuple):
    pose: Floats  # (N, 3), headings without jumps
    stamps_ns: Ints | None  # (N,)


@dataclass
class Recorded:
    """Wheel odometry from a file: poses in a frame of its own that drifts, of which only the differences are used.

    The file is one that `omnilab.trajectory.files.read_trajectory` reads, with the poses of the camera (of a robot, where
    the camera stands over its centre and looks ahead). With stamps, a pose is interpolated at the time of the image, on
    the sensor's clock; without, the file's rows are the frames of the plan. The covariance is of the settings below.
    With `topic` the file is a bag of ROS or an MCAP log, as of the sensor `rosbag`, and the poses are those of its body.
    """

    file: str = "???"  # the poses: TUM's format, or a CSV; with `topic`, a log
    translation_noise: float = setting(
        0.05, at_least=0, at_most=1000
    )  # standard deviation of x and of y, as a share of the step
    still_noise_m: float = setting(0.001, at_least=1e-12, at_most=1e6)  # and at least, of a step of no length
    heading_noise_deg: float = setting(
        0.5, at_least=1e-12, at_most=1e6
    )  # standard deviation of the heading, however little the camera turns
    turn_noise: float = setting(0.02, at_least=0, at_most=1000)  # and besides, as a share of the turn
    topic: str | None = None  # of a log: an Odometry, a PoseStamped or the like

    def __post_init__(self) -> None:
        check_settings(self)

    _met = False  # an image that the file covers

    def extract(self, frames: Frames) -> Sequence[Reading]:
        """The recorded pose of each image; DataError for a file without stamps that is too short, or of another clock."""
        pose, stamps = self._record
        if stamps is not None:
            self._check_clock(frames.stamps_ns, stamps)
            time, wanted = (t - stamps[0] for t in (stamps, frames.stamps_ns))  # floats hold no nanoseconds since 1970
            found = [np.interp(wanted, time, column, left=np.nan, right=np.nan) for column in pose.T]
            return [Reading(one) for one in np.column_stack(found)]
        if len(frames) and (last := int(frames.plan_index.max())) >= len(pose):
            raise DataError(
                f"{self.file} has {len(pose)} poses and no stamps, and image {last + 1} is requested; give a pose for each"
                " image, or stamps"
            )
        return [Reading(one) for one in pose[frames.plan_index]]

    def _check_clock(self, images_ns: Ints, stamps_ns: Ints) -> None:
        """DataError for images farther from the file than it is long, before any that it covers."""
        self._met |= not len(images_ns) or clocks.overlap(images_ns, stamps_ns)
        apart = max(images_ns.min() - stamps_ns[-1], stamps_ns[0] - images_ns.max()) if len(images_ns) else 0
        if not self._met and apart > stamps_ns[-1] - stamps_ns[0]:
            raise DataError(clocks.differ(images_ns, stamps_ns, self.file))

    def estimate(self, before: Reading, now: Reading, rng: np.random.Generator) -> Motion:  # noqa: ARG002
        """The second pose in the frame of the first, in metres; draws nothing."""
        both = np.stack([before.pose, now.pose])
        if not np.isfinite(both).all():
            assert self._record.stamps_ns is not None
            covered = f"the odometry's file covers {clocks.span(self._record.stamps_ns)}, and not both images"
            return Motion(np.full(3, np.nan), np.eye(3), "m", covered)
        T = planar_poses(np.column_stack([both[:, :2], np.zeros(2)]), both[:, 2])
        (vector,) = vectors((inverse(T[0]) @ T[1])[None], planar=True)
        place = np.hypot(self.translation_noise * np.hypot(*vector[:2]), self.still_noise_m)
        heading = np.hypot(np.deg2rad(self.heading_noise_deg), self.turn_noise * vector[2])
        return Motion(vector, np.diag([place**2, place**2, heading**2]), "m")

    @cached_property
    def _record(self) -> _Record:
        path = (
            read_trajectory(Path(self.file), level=True) if self.topic is None else trajectory_of(self.file, self.topic)
        )
        plausibility.warn(self.file, path)
        stamps = path.stamps_ns
        if stamps is not None and (seldom := clocks.about_seldom(stamps)):
            log.warning("%s: %s", self.file, seldom)
        if stamps is not None and (np.diff(stamps) <= 0).any():
            row = int(np.argmax(np.diff(stamps) <= 0)) + 2
            raise DataError(f"pose {row} of {self.file} is not later than the one before it; sort the file by time")
        pose = vectors(path.T_world_camera, planar=True)
        return _Record(np.column_stack([pose[:, :2], np.unwrap(pose[:, 2])]), stamps)
