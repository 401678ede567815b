"""Maps with few views, on a plain world whose similarities are known; what a view is expected to tell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import Circle, Frames, Motion, Parts, PathPoses, Plan, Unusable
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses
from omnilab.posegraph.graph import inverse, moved, vectors
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import ViewDensity
from omnilab_studies.view_slam.front_end import AssociationSettings, ViewMapper
from omnilab_studies.view_slam.initialisation import Initialisation, expected_gain

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
REACH_M = {"near": 1.0, "far": 3.0}  # R falls to 1 / e


@dataclass
class Street:
    """Six metres straight on; the third image is black."""

    def plan(self, layout):
        x = np.linspace(0, 6, 13)
        T = planar_poses(np.column_stack([x, 0 * x, 0 * x + 1]), 0 * x)
        T = layout.T_world_camera if isinstance(layout, PathPoses) else T
        return Plan([str(i) for i in range(len(T))], T)

    def frames(self, plan):
        images = np.full((len(plan), 16, 16), 50, np.uint8)
        images[2] = 0
        n = np.arange(len(plan))
        yield Frames(images, plan.keys, 100 * n, CAMERA, n, plan.T_world_camera)

    def scene(self):
        return None


@dataclass
class Wheels:
    """The true motion of a step, with noise by the seed."""

    def extract(self, frames):
        return list(frames.T_world_camera)

    def estimate(self, before, now, rng):
        (vector,) = vectors((inverse(before) @ now)[None], planar=True)
        return Motion(vector + 0.01 * rng.standard_normal(3), 1e-4 * np.eye(3), "m")


@dataclass
class Alike:
    """Two images are alike by exp(-distance / reach), and their directions true."""

    reach_m: float

    def extract(self, frames):
        return [T if i.any() else Unusable("black") for T, i in zip(frames.T_world_camera, frames.images, strict=True)]

    def estimate(self, before, now, rng):
        (vector,) = vectors((inverse(before) @ now)[None], planar=True)
        distance = np.hypot(*vector[:2])
        agree = np.arange(200) < 200 * np.exp(-distance / self.reach_m)
        step = vector / [distance, distance, 1] if distance else np.array([1, 0, vector[2]])
        return Motion(step, 1e-6 * np.eye(3), "1", "", np.full((200, 2, 2), 0.5), agree, features=400)


@dataclass
class DeadReckoning:
    """Odometry alone."""

    def begin(self, pose, covariance):
        return Reckoned(pose)


class Reckoned:
    def __init__(self, pose):
        self.trajectory, self.taken = [pose], []

    def predict(self, motion, covariance):
        self.trajectory.append(moved(self.trajectory[-1], motion))
        return []

    def observe(self, views, angles_rad, covariances):
        return np.ones(len(views), bool), []

    def add_view(self):
        self.taken.append(self.trajectory[-1])
        return len(self.taken) - 1

    def pose(self):
        return self.trajectory[-1], 1e-4 * np.eye(3)

    def views(self):
        return np.array(self.taken).reshape(-1, 3)

    def view_covariances(self):
        return np.tile(1e-4 * np.eye(3), (len(self.taken), 1, 1))


def parts(**changed):
    ready = Parts(
        sensor=Street(), odometry=Wheels(), odometries={name: Alike(reach) for name, reach in REACH_M.items()},
        view_filters={"reckoned": DeadReckoning()},
    )  # fmt: skip
    return replace(ready, **changed)


STUDY = ViewDensity(every_m=0.1, similarities=[0.3, 0.6], gains=[0.5], seeds=2, references=3, compared=30, show=4)


@pytest.fixture(scope="module")
def report():
    return STUDY.run(parts(), Recorder(), np.random.default_rng(1))


def test_it_keeps_the_contract_of_studies():
    check_study(replace(STUDY, similarities=[0.5], gains=[]), parts())


@pytest.mark.parametrize("name", REACH_M)
@pytest.mark.parametrize("threshold", [0.3, 0.6])
def test_views_are_as_far_apart_as_images_are_alike(report, name, threshold):
    table = report.tables["density"]
    (k,) = [i for i in range(len(table["label"])) if (table["label"][i], table["threshold"][i]) == (name, threshold)]
    apart = -REACH_M[name] * np.log(threshold)  # and up to a step more, where the next image is taken
    assert 6 / (apart + 0.2) <= table["views"][k] <= 6 / apart + 1
    assert table["rms_m"][k] == pytest.approx(table["odometry_rms_m"][k])


def test_similarity_against_distance_is_that_of_the_world(report):
    table = report.tables["similarity"]
    for name, at, alike in zip(table["method"], table["distance_m"], table["similarity"], strict=True):
        assert alike == pytest.approx(np.exp(-at / REACH_M[name]), abs=0.06)
    assert max(table["bearing_error_deg"]) < 1e-5
    found = {metric.name: metric.value for metric in report.metrics}
    assert found["near_similarity_1m"] == pytest.approx(np.exp(-1), abs=0.06)
    assert found["reckoned_far_fewest_views"] < found["reckoned_near_fewest_views"]
    assert set(report.figures) == {"density", "similarity"}


def test_without_two_images_to_compare_there_are_maps_all_the_same():
    found = replace(STUDY, similarities=[0.5], gains=[], compared=1).run(parts(), Recorder(), np.random.default_rng(1))
    assert set(found.figures) == {"density"}
    assert set(found.tables) == {"density", "drives"}


def test_what_a_view_tells_is_the_ratio_of_determinants():
    drift, sigma = np.diag([0.01, 0.04, 0.001]), 0.02
    none = expected_gain(np.zeros((0, 2)), np.zeros((0, 2, 2)), drift, sigma, 2.0)
    own = np.array([0.5 / 4, 0.5 / 4, 2.0]) / sigma**2
    assert none == pytest.approx(0.5 * np.log(1 + own * np.diagonal(drift)).sum())
    # a view straight ahead at 3 m: its bearing sees y and the heading, its relative orientation the heading
    known = np.linalg.inv(drift)
    for J in ([0, -1 / 3, -1], [0, 0, -1]):
        known = known + np.outer(J, J) / sigma**2
    one = expected_gain(np.array([[3.0, 0]]), sigma**2 * np.eye(2)[None], drift, sigma, 2.0)
    ratio = np.linalg.det(known + np.diag(own)) / np.linalg.det(known)
    assert one == pytest.approx(0.5 * np.log(ratio))
    beside = expected_gain(np.array([[3.0, 0], [0, 3]]), sigma**2 * np.tile(np.eye(2), (2, 1, 1)), drift, sigma, 2.0)
    assert none > one > beside > 0


def test_views_by_information_begin_with_the_first_image_and_end_where_enough_is_known():
    def views(gain):
        settings = AssociationSettings(
            initialisation=Initialisation.information, least_gain=gain, range_m=9.0, candidates=9, nearest_m=0.3
        )
        wheels, T = Wheels(), Street().plan(None).T_world_camera
        mapper = ViewMapper(DeadReckoning(), settings, lambda i, j: Alike(9.0).estimate(T[i], T[j], None), np.zeros(3))
        mapper.process(0, T[0], None, None)
        assert mapper.images == [0]
        for i in range(1, len(T)):
            motion = wheels.estimate(T[i - 1], T[i], np.random.default_rng(i))
            mapper.process(i, T[i], motion.vector, motion.covariance)
        return len(mapper.images)

    assert views(20.0) == 1
    assert views(0.01) == len(Street().plan(None))  # half a metre apart: all may be taken
    assert views(20.0) <= views(0.5) <= views(0.01)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"similarities": []}, "similarities"),
        ({"similarities": [1.5]}, "similarities"),
        ({"gains": [0.0]}, "gains"),
        ({"seeds": 1}, "seeds=1"),
    ],
)
def test_thresholds_that_cannot_be_are_refused(changed, message):
    with pytest.raises(ConfigError, match=message):
        replace(STUDY, **changed)


def test_parts_that_are_missing_or_not_used_are_named():
    with pytest.raises(ConfigError, match=r"sensors\.known is not used: these maps begin empty; leave it out"):
        STUDY.run(parts(sensors={"known": Street()}), Recorder(), np.random.default_rng(0))
    with pytest.raises(ConfigError, match=r"odometries\.NAME=guided_epipolar"):
        STUDY.run(parts(odometries={}), Recorder(), np.random.default_rng(0))
    with pytest.raises(ConfigError, match="needs view filters"):
        STUDY.run(parts(view_filters={}), Recorder(), np.random.default_rng(0))
