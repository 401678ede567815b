"""The study of maps of views from images, on plain parts: which views are observed, when one is taken, warnings."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Circle, Frames, Image, Motion, NamedPath, Parts, PathPoses, Plan, RecordedPoses, Unusable
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses, wrap_angle
from omnilab.posegraph.graph import between, inverse, moved, vectors
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import ViewSlam
from omnilab_studies.common.match_images import draw_image_pair
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.view_slam.front_end import AssociationSettings, ViewMapper, angles_of, similarity
from omnilab_studies.view_slam.study import spaced

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


def ring(count: int = 40, radius: float = 1.0):
    angle = np.linspace(0, 2 * np.pi, count)
    at = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(count)])
    return planar_poses(at, wrap_angle(angle + np.pi / 2))


@dataclass
class Ring:
    """Drives a circle."""

    black: list[int] = field(default_factory=list)
    known: bool = True
    count: int = 40
    camera: ImageCircle = CAMERA
    requests: list[Any] = field(default_factory=list)

    def plan(self, layout):
        self.requests.append(layout)
        T = layout.T_world_camera if isinstance(layout, PathPoses) else ring()[: self.count]
        return Plan([str(i) for i in range(len(T))], T if self.known else None)

    def frames(self, plan):
        for start in range(0, len(plan), 9):
            part = np.arange(start, min(start + 9, len(plan)))
            images = np.full((len(part), 16, 16), 50, np.uint8)
            images[np.isin(part, self.black)] = 0
            yield Frames(images, [plan.keys[i] for i in part], part * 100, self.camera, part, plan.T_world_camera[part])

    def scene(self):
        return None


@dataclass
class Exact:
    """Knows the true motion of a step, with noise by the seed."""

    noise: float = 0.0
    fails: bool = False

    def extract(self, frames):
        return list(frames.T_world_camera)

    def estimate(self, before, now, rng):
        (vector,) = vectors((inverse(before) @ now)[None], planar=True)
        if self.fails:
            return Motion(np.full(3, np.nan), np.eye(3), "m", "stuck")
        return Motion(vector + self.noise * rng.standard_normal(3), (self.noise**2 + 1e-6) * np.eye(3), "m")


@dataclass
class Seeing(Exact):
    """Relates two images: the nearer they were taken the more matches agree."""

    def extract(self, frames):
        return [T if i.any() else Unusable("black") for T, i in zip(frames.T_world_camera, frames.images, strict=True)]

    def estimate(self, before, now, rng):
        (vector,) = vectors((inverse(before) @ now)[None], planar=True)
        agree = np.arange(100) < 100 * np.exp(-np.hypot(*vector[:2]))
        matches = np.full((100, 2, 2), 0.5)
        return Motion(vector * [0.3, 0.3, 1], 1e-6 * np.eye(3), "1", "", matches, agree, features=200)


@dataclass
class Believing:
    """Believes odometry alone, and keeps the covariances of known views."""

    def __post_init__(self):
        self.begun = []

    def begin(self, pose, covariance):
        self.begun.append(Belief(pose))
        return self.begun[-1]


class Belief:
    def __init__(self, pose):
        self.trajectory, self.taken, self.seen, self.known = [pose], [], [], []

    def predict(self, motion, covariance):
        assert np.linalg.eigvalsh(covariance)[0] > 0
        self.trajectory.append(moved(self.trajectory[-1], motion))
        return []

    def observe(self, views, angles_rad, covariances):
        assert angles_rad.shape == (len(views), 2)
        self.seen += [(self.taken[v], self.trajectory[-1], angles) for v, angles in zip(views, angles_rad, strict=True)]
        return np.arange(len(views)) > 0, ["one too many"] if len(self.trajectory) == 3 else []

    def add_view(self):
        self.taken.append(self.trajectory[-1])
        return len(self.taken) - 1

    def know_view(self, pose, covariance):
        self.known.append(covariance)
        self.taken.append(pose)
        return len(self.taken) - 1

    def pose(self):
        return self.trajectory[-1], 1e-4 * np.eye(3)

    def views(self):
        return np.array(self.taken).reshape(-1, 3)

    def view_covariances(self):
        return np.tile(1e-4 * np.eye(3), (len(self.taken), 1, 1))

    def finish(self):
        return np.array(self.trajectory)


def parts(**changed):
    ready = {
        "sensor": Ring(),
        "odometry": Exact(),
        "odometries": {"views": Seeing()},
        "view_filters": {"belief": Believing()},
    }
    return Parts(**{**ready, **changed})


def run(study=None, record=None, **changed):
    return (study or ViewSlam(every_m=0.2, every_rad=0.5)).run(
        parts(**changed), record or Recorder(), np.random.default_rng(5)
    )


def values(report):
    return {metric.name: metric.value for metric in report.metrics}


def test_it_keeps_the_contract_of_studies():
    noisy = Exact(noise=0.01)
    check_study(ViewSlam(every_m=0.2, every_rad=0.5), parts(odometry=noisy))


def test_views_are_taken_where_nothing_is_like_them_and_seen_from_near_by():
    found = values(run(ViewSlam(every_m=0.1, every_rad=0.5, views=AssociationSettings(similarity=0.5, range_m=1.2))))
    # half of the matches agree up to ln 2 m, which the next image, up to 0.1 m later, exceeds
    assert found["belief_views"] == pytest.approx(2 * np.pi / (np.log(2) + 0.1), abs=1)
    assert found["belief_observed"] > 50
    assert found["belief_rms"] == pytest.approx(0, abs=1e-9)
    assert found["odometry_rms"] == pytest.approx(0, abs=1e-9)
    assert 0 < found["belief_gated"] < 1


def test_what_is_observed_are_the_true_angles():
    rng = np.random.default_rng(0)
    truth, sensor = ring(), Ring()
    (frames,) = [f for f in sensor.frames(sensor.plan(RecordedPoses())) if f.plan_index[0] == 0]
    features = Seeing().extract(frames)
    relative_pose = lambda i, j: Seeing().estimate(features[i], features[j], rng)
    start = vectors(truth[:1], planar=True)[0]
    mapper = ViewMapper(Believing(), AssociationSettings(nearest_m=0.0, similarity=0.9), relative_pose, start)
    mapper.process(0, features[0], None, None)
    for i in range(1, 9):
        step = vectors((inverse(truth[i - 1]) @ truth[i])[None], planar=True)[0]
        mapper.process(i, features[i], step, np.eye(3))
    assert len(mapper.map.seen) > 5
    for view, robot, (bearing, turn) in mapper.map.seen:
        assert wrap_angle(bearing - np.arctan2(*(view - robot)[1::-1]) + robot[2]) == pytest.approx(0, abs=1e-9)
        assert wrap_angle(turn - view[2] + robot[2]) == pytest.approx(0, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(x=st.floats(-2, 2), y=st.floats(0.1, 2), turn=st.floats(-3, 3), seed=st.integers(0, 99))
def test_the_covariance_of_the_angles_is_that_of_the_motion(x, y, turn, seed):
    spread = np.random.default_rng(seed).standard_normal((3, 3)) * 0.01
    motion = Motion(np.array([x, y, turn]), spread @ spread.T, "1")
    angles, covariance = angles_of(motion, 1e-9)
    step = 1e-6
    J = np.array([
        (angles_of(Motion(motion.vector + step * axis, motion.covariance, "1"), 0)[0] - angles) / step for axis in np.eye(3)
    ]).T  # fmt: skip
    assert covariance == pytest.approx(J @ motion.covariance @ J.T, rel=1e-3, abs=1e-9)


def test_similarity_is_that_of_the_print():
    assert similarity(Motion(np.zeros(3), np.eye(3), "m", agree=np.array([1, 1, 0], bool), features=8)) == 2 * 2 / 8
    assert similarity(Motion(np.zeros(3), np.eye(3), "m")) == 0


def test_black_images_and_lost_odometry_are_warnings_and_cost_no_more():
    lines = []

    class Watching(Recorder):
        def log(self, path, record, tick=None):
            if path == "log":
                lines.append(record.text)
            if path == "query/panorama":
                assert isinstance(record, Image)

    report = run(record=Watching(), sensor=Ring(black=[3]), odometry=Exact(fails=True))
    found = values(report)
    assert found["lost_steps"] == found["images"] - 1
    assert any("image 3" in line and "black" in line for line in lines)
    assert any("stuck" in line for line in lines)
    assert report.tables["steps"]["belief_observed"][3] == 0


def test_views_from_before_are_seen_and_none_is_taken_beside_them():
    view_filter = Believing()
    found = values(run(sensors={"known": Ring(black=[5])}, view_filters={"belief": view_filter}))
    assert found["known_views"] == 39  # the black one is left out
    assert found["belief_views"] == 0
    assert found["belief_observed"] > 50
    belief = view_filter.begun[-1]
    assert np.allclose(belief.views(), np.delete(vectors(ring(), planar=True), 5, axis=0))
    assert np.allclose(belief.known[0], np.diag([0.05, 0.05, np.deg2rad(1)]) ** 2)


def test_views_of_another_camera_are_refused():
    other = ImageCircle(16, 16, Circle(7.5, 7.5, 7))
    with pytest.raises(DataError, match=r"another camera .*radius=7.* than the images .*radius=8"):
        run(sensors={"known": Ring(camera=other)})


def test_views_from_before_without_poses_or_under_another_name_are_refused():
    with pytest.raises(DataError, match=r"sensors\.known have no poses"):
        run(sensors={"known": Ring(known=False)})
    with pytest.raises(ConfigError, match=r"sensors\.knwon is not used"):
        run(sensors={"knwon": Ring()})


def test_kept_views_are_a_data_set_of_images_and_mapped_poses(tmp_path):
    study = ViewSlam(every_m=0.2, every_rad=0.5, keep=str(tmp_path / "views"))
    view_filter = Believing()
    run(study, view_filters={"belief": view_filter, "second": Believing()}, odometry=Exact(noise=0.01))
    mapped = view_filter.begun[-1].views()
    about = json.loads((tmp_path / "views/dataset.json").read_text())
    assert about["complete"]
    assert about["views"] == len(mapped) == len(list((tmp_path / "views/images").iterdir()))
    with (tmp_path / "views/positions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(float(row["x_m"]), float(row["y_m"]), float(row["z_m"])) for row in rows] == [(*p[:2], 1) for p in mapped]
    assert [float(row["yaw_deg"]) for row in rows] == pytest.approx(np.rad2deg(mapped[:, 2]))
    run(study, view_filters={"belief": Believing(), "second": Believing()}, odometry=Exact(noise=0.01))  # once more
    with pytest.raises(DataError, match=r"study\.keep=.* holds another data set"):
        run(study, view_filters={"belief": Believing()}, odometry=Exact(noise=0.02))


def test_files_and_tables_hold_every_trajectory():
    report = run()
    count = values(report)["images"]
    assert {f"{name}.tum" for name in ("odometry", "truth", "belief", "belief_final")} == set(report.files)
    assert all(len(text.splitlines()) == count for text in report.files.values())
    assert report.tables["filters"]["filter"] == ["belief"]
    assert set(report.figures) == {"belief", "cost"}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"odometries": {}}, "odometries.views=planar_epipolar"),
        ({"view_filters": {}}, "needs view filters"),
    ],
)
def test_parts_that_are_missing_are_named(changed, message):
    with pytest.raises(ConfigError, match=message):
        run(**changed)


def test_images_without_poses_or_alone_are_refused():
    with pytest.raises(DataError, match="have no poses"):
        run(ViewSlam(images=Source.recorded), sensor=Ring(known=False))
    with pytest.raises(DataError, match="a sequence of 1 image"):
        run(ViewSlam(images=Source.recorded), sensor=Ring(count=1))


@pytest.mark.parametrize(
    "wrong", [{"images": Source.random}, {"every_m": 0}, {"every_rad": -1}, {"show": 0}, {"known_sigma_m": 0}]
)
def test_settings_that_mean_nothing_are_refused(wrong):
    with pytest.raises(ConfigError, match=r"study\."):
        ViewSlam(**wrong)


@pytest.mark.parametrize(
    "wrong", [{"nearest_m": 3.0}, {"candidates": 0}, {"similarity": 0.0}, {"least": 1}, {"sigma_deg": 0.0}]
)
def test_associations_that_see_nothing_are_refused(wrong):
    with pytest.raises(ConfigError, match=r"study\.views\."):
        AssociationSettings(**wrong)


@pytest.mark.parametrize(("every_m", "every_rad"), [(5e-324, 0.1), (1e-9, 0.1), (0.1, 5e-324)])
def test_images_without_number_on_a_path_are_refused(every_m, every_rad):
    bent = planar_poses([[0, 0, 1], [4, 0, 1]], [0, 1])
    with pytest.raises(ConfigError, match=r"study.every_m=.* more than 1000000 images on this path; give larger ones"):
        spaced(bent, every_m, every_rad)


def test_the_path_of_the_world_is_requested_by_name_and_spaced():
    sensor = Ring()
    run(ViewSlam(path="around", height_m=0.7, every_m=0.2, every_rad=0.1), sensor=sensor)
    assert sensor.requests[0] == NamedPath("around", 0.7)
    placed = sensor.requests[1].T_world_camera
    turned = np.abs(wrap_angle(np.diff(heading_of(placed))))
    assert turned == pytest.approx(0.1, abs=0.01)  # it turns 0.1 before it has gone 0.2 m
    straight = planar_poses(np.column_stack([np.arange(5.0), np.zeros(5), np.ones(5)]))
    step = between(vectors(spaced(straight, 0.3, 0.1), planar=True), np.array([[0, 1]]))[0]
    assert step == pytest.approx([0.3, 0, 0], abs=0.03)


def test_two_panoramas_are_joined_where_matches_agree():
    grey = np.zeros((8, 64), np.uint8)
    matches = np.array([[[1.0, 0.5], [2.0, 0.5]], [[3.0, 0.5], [4.0, 0.5]]])
    motion = Motion(np.zeros(3), np.eye(3), "m", "", matches, np.array([True, False]))
    picture = draw_image_pair(grey, grey, motion)
    assert picture.shape == (32, 128, 3)
    green, red = picture[:, :, 1].astype(int), picture[:, :, 0].astype(int)
    assert (green - red > 60).any(axis=1).sum() > 14  # a line from one to the other
    assert 0 < (red - green > 60).any(axis=1).sum() < 14  # dots alone
    assert not draw_image_pair(grey, None, None).any()
