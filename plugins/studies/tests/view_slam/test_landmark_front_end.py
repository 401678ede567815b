"""Landmarks in the study of maps of views: matching, following, taking, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from omnilab.api import Circle, Frames, ImageFeatures, Motion, Parts, PathPoses, Plan, Unusable
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses, wrap_angle
from omnilab.posegraph.graph import inverse, vectors
from omnilab.runner.recorder import Recorder
from omnilab_studies import ViewRange, ViewSlam
from omnilab_studies.view_slam.front_end import FilterClock
from omnilab_studies.view_slam.landmark_front_end import LandmarkMapper, LandmarkSettings, matched
from omnilab_studies.view_slam.results import time_rows

RNG = np.random.default_rng(4)
POINTS = np.column_stack([5 * np.cos(np.arange(30)), 5 * np.sin(np.arange(30)), RNG.uniform(-1, 1, 30)])
DESCRIPTORS = RNG.integers(0, 255, (30, 32)).astype(np.uint8)


def features_at(pose, which=slice(None)):
    """The points as the robot sees them from a pose (3,)."""
    off = POINTS[which] - [*pose[:2], 0]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    own = off @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    unit = (own / np.linalg.norm(own, axis=1, keepdims=True)).astype(np.float32)
    return ImageFeatures(unit, np.zeros((len(own), 2), np.float32), DESCRIPTORS[which])


@dataclass
class Points:
    """A filter that keeps what it is told, and knows the poses."""

    observes: ClassVar[str] = "landmarks"

    def begin(self, pose, covariance):
        return Told(pose)


class Told:
    def __init__(self, pose):
        self.trajectory, self.count, self.seen = [pose], 0, []

    @property
    def variables(self):
        return 3 + 5 * self.count

    def predict(self, motion, covariance):
        self.trajectory.append(self.trajectory[-1] + motion)
        return []

    def observe(self, views, angles_rad, covariances):
        assert np.allclose(covariances, np.deg2rad(0.5) ** 2 * np.eye(2))
        self.seen.append((views, angles_rad))
        return np.ones(len(views), bool), []

    def add_view(self):
        self.count += 1
        return self.count - 1

    def pose(self):
        return self.trajectory[-1], 1e-4 * np.eye(3)

    def views(self):
        return np.zeros((self.count, 3))

    def view_covariances(self):
        return np.tile(1e-4 * np.eye(3), (self.count, 1, 1))

    def finish(self):
        return np.array(self.trajectory)


def test_descriptors_match_where_both_are_nearest_and_the_second_best_is_far():
    known = np.eye(5, dtype=np.float32)[[0, 1, 2, 0]]  # the first landmark twice: of one of them it is still clear
    seen = np.eye(5, dtype=np.float32)[[2, 0, 4]]
    landmarks, found = matched(known, seen, 0.8)
    assert list(zip(landmarks.tolist(), found.tolist(), strict=True)) == [(0, 1), (2, 0)]
    twice = seen[[0, 0, 1]]  # two features are as alike: neither is clear
    assert matched(known[2:3], twice, 0.8)[0].size == 0
    assert matched(np.zeros((0, 0), np.float32), seen, 0.8)[0].size == 0


def test_the_first_features_are_landmarks_and_are_seen_in_their_true_directions():
    mapper = LandmarkMapper(Points(), LandmarkSettings(wanted=12, followed=3, apart_deg=1.0), np.zeros(3))
    for i in range(3):
        pose = np.array([0.1 * i, 0.02 * i, 0.05 * i])
        found = mapper.process(i, features_at(pose), None if i == 0 else np.array([0.1, 0.02, 0.05]), np.eye(3))
        assert mapper.images == [0] * 12  # the strongest: the first points
        assert len(found.views) == (0 if i == 0 else 12)
        if i > 0:
            off = POINTS[found.views] - [*pose[:2], 0]
            bearings = np.arctan2(off[:, 1], off[:, 0]) - pose[2]
            assert wrap_angle(found.angles_rad[:, 0] - bearings) == pytest.approx(0, abs=1e-5)
            assert found.angles_rad[:, 1] == pytest.approx(np.arctan2(off[:, 2], np.hypot(*off[:, :2].T)), abs=1e-5)
    assert mapper.clock.variables == [63, 63, 63]


def test_later_features_become_landmarks_when_they_were_followed():
    mapper = LandmarkMapper(Points(), LandmarkSettings(wanted=12, followed=3, apart_deg=1.0), np.zeros(3))
    mapper.process(0, features_at(np.zeros(3), slice(0, 2)), None, None)
    for i in range(1, 6):
        mapper.process(i, features_at(np.zeros(3)), np.zeros(3), np.eye(3))
        assert len(mapper.images) == (2 if i < 3 else 12)
    assert mapper.images == [0] * 2 + [3] * 10


def test_what_is_lost_is_replaced_and_new_landmarks_keep_apart():
    mapper = LandmarkMapper(Points(), LandmarkSettings(wanted=6, followed=1, apart_deg=20.0), np.zeros(3))
    mapper.process(0, features_at(np.zeros(3), slice(0, 15)), None, None)
    first = len(mapper.images)
    assert first == 6
    mapper.process(1, features_at(np.zeros(3), slice(4, 30)), np.zeros(3), np.eye(3))
    ((_, kept), (_, new)) = mapper.map.seen[1:]
    assert len(kept) + len(new) == 6
    unit = lambda a: np.stack(
        [np.cos(a[:, 1]) * np.cos(a[:, 0]), np.cos(a[:, 1]) * np.sin(a[:, 0]), np.sin(a[:, 1])], -1
    )
    cosine = unit(new) @ unit(np.concatenate([kept, new])).T
    assert (np.sort(cosine, axis=1)[:, -2] < np.cos(np.deg2rad(20))).all()
    mapper.process(2, Unusable("black"), np.zeros(3), np.eye(3))
    assert len(mapper.poses) == 3


def test_features_without_directions_are_refused():
    mapper = LandmarkMapper(Points(), LandmarkSettings(), np.zeros(3))
    with pytest.raises(ConfigError, match=r"odometries\.views extracts others; give \+odometry@odometries\.views="):
        mapper.process(0, "something else", None, None)


@dataclass
class Line:
    """Drives straight on, past the points."""

    def plan(self, layout):
        at = np.column_stack([np.linspace(0, 1, 8), np.zeros(8), np.ones(8)])
        T = layout.T_world_camera if isinstance(layout, PathPoses) else planar_poses(at)
        return Plan([str(i) for i in range(len(T))], T)

    def frames(self, plan):
        count = len(plan)
        camera = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
        yield Frames(
            np.full((count, 16, 16), 9, np.uint8),
            plan.keys,
            np.arange(count),
            camera,
            np.arange(count),
            plan.T_world_camera,
        )

    def scene(self):
        return None


@dataclass
class Seeing:
    """Odometry without error; features are the points."""

    points: bool = False

    def extract(self, frames):
        poses = vectors(frames.T_world_camera, planar=True)
        return [features_at(pose) for pose in poses] if self.points else list(frames.T_world_camera)

    def estimate(self, before, now, rng):
        return Motion(vectors((inverse(before) @ now)[None], planar=True)[0], 1e-6 * np.eye(3), "m")


def parts(**changed):
    ready = {
        "sensor": Line(),
        "odometry": Seeing(),
        "odometries": {"views": Seeing(True)},
        "view_filters": {"points": Points()},
    }
    return Parts(**{**ready, **changed})


def test_landmarks_are_mapped_beside_views_and_counted():
    report = ViewSlam(every_m=0.1, landmarks=LandmarkSettings(apart_deg=1.0)).run(
        parts(), Recorder(), np.random.default_rng(0)
    )
    found = {metric.name: metric.value for metric in report.metrics}
    assert found["points_views"] == 30
    assert found["points_variables"] == 3 + 5 * 30
    assert found["points_observed"] == 30 * (found["images"] - 1)
    assert found["points_rms"] == pytest.approx(0, abs=1e-9)
    assert report.tables["times"]["variables"] == [153]
    assert set(report.figures) == {"points", "cost"}


def test_a_clock_counts_what_the_filter_takes_and_nothing_of_a_map_that_does_not_say_its_variables():
    clock = FilterClock(object())
    for work in (10, 200_000):
        clock.begin_image()
        clock.run(sum, range(work))
        clock.end_image()
    assert clock.seconds[1] > clock.seconds[0] >= 0
    (row,) = time_rows({"one": clock})
    assert np.isnan(row["variables"])
    assert row["last_ms"] == 1e3 * clock.seconds[1]


@pytest.mark.parametrize(
    ("study", "changed", "message"),
    [
        (
            ViewRange(),
            {},
            r"view_filters\.points observes landmarks, and these drives have views alone.*experiment=view_slam",
        ),
        (ViewSlam(), {"sensors": {"known": Line()}}, r"leave out sensors\.known, or ~view_filters\.points"),
        (
            ViewSlam(keep="views"),
            {},
            r"study\.keep=views keeps the views of the first filter.*name a filter of views first",
        ),
    ],
)
def test_landmarks_where_views_are_needed_are_refused(study, changed, message):
    with pytest.raises(ConfigError, match=message):
        study.run(parts(**changed), Recorder(), np.random.default_rng(0))


@pytest.mark.parametrize(
    "wrong", [{"wanted": 0}, {"followed": 0}, {"ratio": 0.0}, {"apart_deg": -1}, {"sigma_deg": 0.0}]
)
def test_settings_that_mean_nothing_are_refused(wrong):
    with pytest.raises(ConfigError, match=r"study\.landmarks\."):
        LandmarkSettings(**wrong)
