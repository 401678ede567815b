"""Views on a world whose pictures are known beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Frames, Image, Parts, PathPoses, Plan, PointCloud, Pose
from omnilab.cameras import EquirectangularCamera
from omnilab.errors import ConfigError
from omnilab.geometry import rotation_xyz
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Views

CAMERA = EquirectangularCamera(64, 32)
POSES = [[1.0, 2.0, 3.0, 0.0, 0.0, 0.0], [1.0, 2.0, 3.0, 10.0, 20.0, 30.0]]


@dataclass
class Ball:
    """The inside of a ball of 2 m radius around every pose, whose lower half is out of sight."""

    depth: bool = True

    def plan(self, layout):
        assert isinstance(layout, PathPoses)
        return Plan([str(i) for i in range(len(layout.T_world_camera))], layout.T_world_camera)

    def frames(self, plan):
        for i in range(len(plan)):
            image = np.full((1, 32, 64), 100, np.uint8)
            depth = np.full((1, 32, 64), 2, np.float32)
            depth[:, 16:] = np.inf
            yield Frames(
                image, [plan.keys[i]], np.array([i]), CAMERA, np.array([i]), plan.T_world_camera[i : i + 1],
                depth_m=depth if self.depth else None,
            )  # fmt: skip

    def scene(self):
        return None


class Kept(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.records = []

    def log(self, path, record, tick=None):
        self.records.append((path, record))

    def of(self, kind):
        return [record for _, record in self.records if isinstance(record, kind)]


def test_every_pose_is_shown():
    record = Kept()
    report = Views(POSES).run(Parts(sensor=Ball()), record, np.random.default_rng(0))
    assert len(record.of(Image)) == 4  # pictures and panoramas
    first, second = record.of(Pose)
    assert np.allclose(first.T_world_camera[:3, 3], [1, 2, 3])
    assert np.allclose(second.T_world_camera[:3, :3], rotation_xyz(*np.deg2rad([10, 20, 30])))
    assert {m.name: m.value for m in report.metrics}["gray_level_mean"] == 100
    assert set(report.figures) == {"views", "cloud"}


def test_a_cloud_holds_what_is_seen_and_no_more():
    record = Kept()
    Views(POSES).run(Parts(sensor=Ball()), record, np.random.default_rng(0))
    level, turned = record.of(PointCloud)
    assert len(level.points_m) == len(turned.points_m) == 16 * 64
    assert np.allclose(np.linalg.norm(level.points_m - [1, 2, 3], axis=1), 2)
    assert (level.points_m[:, 2] > 3).all()
    assert (turned.points_m[:, 2] < 3).any()
    record = Kept()
    Views(POSES[:1], cloud_points=50).run(Parts(sensor=Ball()), record, np.random.default_rng(0))
    assert len(record.of(PointCloud)[0].points_m) == 50


def test_a_sensor_without_depth_gives_no_cloud():
    record = Kept()
    report = Views(POSES, panoramas=False).run(Parts(sensor=Ball(depth=False)), record, np.random.default_rng(0))
    assert not record.of(PointCloud)
    assert set(report.figures) == {"views"}


def test_it_keeps_the_contract():
    check_study(Views(POSES), Parts(sensor=Ball()))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"poses": []}, r"give a list of \[x, y, z, rx, ry, rz\]"),
        ({"poses": [[1, 2, 3]]}, r"\[\[1, 2, 3\]\] are no poses"),
        ({"poses": [[1, 2, 3, 4, 5, "x"]]}, "'x'"),
        ({"poses": [[1, 2, 3, 4, 5, float("nan")]]}, "nan"),
        ({"poses": [7]}, "7"),
        ({"cloud_points": 0}, "cloud_points=0 is out of range"),
    ],
)
def test_bad_settings(settings, words):
    with pytest.raises(ConfigError, match=words):
        Views(**settings)
