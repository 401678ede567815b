"""Rotations between two images, where they are known: three marks on the sky, which no translation moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from omnilab.api import Frames, Image, Match, Parts, PathPoses, Plan, RecordedPoses, Series, Signatures
from omnilab.cameras import EquirectangularCamera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Rotations
from omnilab_studies.descriptors.rotations.pairs import angle_of, heading_and_tilt, pairs_of, random_rotations, rooms_of

CAMERA = EquirectangularCamera(128, 64)
LEVELS = (250, 170, 90)  # grey levels of the marks on the world's x, y and z axes
AT = np.array([[0.0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 0, 1]])


@dataclass
class Sky:
    """Three marks, infinitely far away."""

    unread: bool = False
    asked: list[object] = field(default_factory=list)

    def plan(self, layout):
        self.asked.append(layout)
        given = layout.T_world_camera if isinstance(layout, PathPoses) else planar_poses(AT, [0.0, 0.5, 1.0, -2.0])
        return Plan([str(i) for i in range(len(given))], given)

    def frames(self, plan):
        directions = CAMERA.directions(np.stack(np.meshgrid(np.arange(128.0), np.arange(64.0)), -1))
        images = np.full((len(plan), 64, 128), 10, np.uint8)
        for image, T in zip(images, plan.T_world_camera, strict=True):
            for axis, level in enumerate(LEVELS):
                image[directions @ T[axis, :3] > np.cos(0.3)] = level
        index = np.arange(len(plan))
        omitted = ["3.png: cannot be read"] if self.unread else []
        yield Frames(images, plan.keys, index, CAMERA, index, plan.T_world_camera, omitted)

    def scene(self):
        return None


@dataclass
class Marks:
    """Where the three marks are: (N, 3, 3)."""

    view: ClassVar[str] = "sphere"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"
    default_distance: ClassVar[str] = "aligned"

    def describe(self, images):
        elevation = np.pi / 2 - np.pi * (np.arange(64) + 0.5) / 64
        azimuth = 2 * np.pi * np.arange(128) / 128
        level = np.cos(elevation)[:, None]
        x, y, z = level * np.cos(azimuth), level * np.sin(azimuth), np.repeat(np.sin(elevation)[:, None], 128, 1)
        directions = np.stack([x, y, z], -1) * level[..., None]  # by solid angle
        means = [[directions[image == grey].sum(axis=0) for grey in LEVELS] for image in images]
        return Signatures(np.array(means, np.float32))


@dataclass
class Aligned:
    """The rotation that aligns the marks; or headings alone, or none."""

    gives: str = "R"

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        R = np.array([[Rotation.align_vectors(p, q)[0].as_matrix() for p in index] for q in queries.place])
        zero = np.zeros(R.shape[:2], np.float32)
        if self.gives == "nothing":
            return Match(zero)
        return Match(zero, zero, R) if self.gives == "R" else Match(zero, zero)


def parts_of(**sensor):
    return Parts(
        sensor=Sky(**sensor), descriptors={"marks": Marks(), "still": Marks()},
        distances={"marks": Aligned(), "still": Aligned("headings")}, default_distances={"marks": Aligned(), "still": Aligned()},
    )  # fmt: skip


def run(study, parts, seed=7):
    record = Recorder()
    logged = []
    record.log = lambda path, value, tick=None: logged.append((path, value))  # type: ignore[method-assign]
    return study.run(parts, record, np.random.default_rng(seed)), logged


def test_rotations_of_known_images_are_measured():
    study = Rotations(distances_m=[0, 1, 2], pairs=4, show=5)
    check_study(study, parts_of())
    report, logged = run(study, parts_of())
    metrics = {m.name: m for m in report.metrics}
    assert metrics["pairs"].value == 4 + 4 + 4
    assert metrics["marks_rotation_error_median"].value < 1
    assert metrics["marks_right_rate"].value == 1
    # a method that sees no rotation is off by all of it: any of SO(3), on average 126 degrees
    assert metrics["still_rotation_error_median"].value > 60
    assert metrics["still_2m_rotation_error_median"].value > metrics["marks_2m_rotation_error_median"].value
    undone = [value for path, value in logged if path == "undone"]
    assert len(undone) == 4
    assert all(isinstance(value, Image) for value in undone)
    (errors,) = (value for path, value in logged if path == "error/still")
    assert isinstance(errors, Series)
    assert len(errors.values) == 12


def test_headings_alone_are_those_of_upright_cameras():
    report, _ = run(Rotations(distances_m=[0], pairs=4, largest_tilt_deg=0, show=0), parts_of())
    metrics = {m.name: m.value for m in report.metrics}
    assert metrics["still_tilt_error_median"] == pytest.approx(0, abs=1e-6)
    assert metrics["still_heading_error_median"] == pytest.approx(metrics["still_rotation_error_median"])


def test_recorded_images_are_paired_as_they_are():
    from omnilab_studies.common.pose_sources import Source

    parts = parts_of()
    report, _ = run(Rotations(distances_m=[1], pairs=99, images=Source.recorded), parts)
    assert isinstance(parts.sensor.asked[0], RecordedPoses)
    assert {m.name: m.value for m in report.metrics}["pairs"] == 3  # neighbours
    headings = np.abs(np.diff([0.0, 0.5, 1.0, -2.0]))
    expected = np.rad2deg(np.median(np.minimum(headings, 2 * np.pi - headings)))
    assert {m.name: m.value for m in report.metrics}["still_heading_error_median"] == pytest.approx(expected)
    with pytest.raises(DataError, match=r"no two of the 4 images of one room \(study.room\) are 1 m apart"):
        run(Rotations(distances_m=[1], images=Source.recorded, room=r"\d"), parts)  # each its own


def test_recorded_pairs_are_of_one_room():
    """Of four images 1 m apart in a row, 0 and 1 are of one room, 2 and 3 of another."""
    rng = np.random.default_rng(0)
    plan = Plan([f"images/{room}/{i}.jpg" for i, room in enumerate("aabb")], Sky().plan(None).T_world_camera)
    rooms = rooms_of(plan.keys, "images/[^/]*")
    assert rooms == ["images/a"] * 2 + ["images/b"] * 2
    pairs = pairs_of(plan, [1.0], 99, 0.05, rng, rooms, once=True)
    assert list(zip(pairs.reference, pairs.query, strict=True)) == [(0, 1), (2, 3)]
    with pytest.raises(DataError, match=r"no two of the 4 images of one room \(study.room\) are 2 m apart"):
        pairs_of(plan, [2.0], 99, 0.05, rng, rooms)


@pytest.mark.parametrize(
    ("room", "sentence"),
    [
        ("/a/", r"study.room='/a/' matches nothing in 2 of 4 names of images, images/b/2.jpg say"),
        ("(", r"study.room='\(' is no regular expression \(.*\); mend it"),
        ("a" * 301, r"study.room has 301 characters; give a pattern of at most 300"),
    ],
)
def test_what_names_no_room_is_said(room, sentence):
    with pytest.raises(ConfigError, match=sentence):
        rooms_of(["images/a/0.jpg", "images/a/1.jpg", "images/b/2.jpg", "images/b/3.jpg"], room)


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.floats(0, np.pi))
def test_random_rotations_tilt_by_no_more_than_they_may(seed, largest):
    R = random_rotations(20, largest, np.random.default_rng(seed))
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    assert heading_and_tilt(R)[1].max() <= largest + 1e-7
    np.testing.assert_allclose(angle_of(R), Rotation.from_matrix(R).magnitude(), atol=1e-7)


def test_with_a_half_turn_of_tilt_they_are_uniform_on_so3():
    """The mean angle is pi / 2 + 2 / pi (Miles, 1965), and the mean matrix is zero."""
    R = random_rotations(20_000, np.pi, np.random.default_rng(1))
    assert angle_of(R).mean() == pytest.approx(np.pi / 2 + 2 / np.pi, abs=0.02)
    assert np.abs(R.mean(axis=0)).max() < 0.02


def test_what_cannot_be_measured_is_refused_in_a_sentence():
    from omnilab_studies.common.pose_sources import Source

    with pytest.raises(DataError, match=r"no two of the 4 images are 7 m apart, give or take 0.05; give other"):
        pairs_of(Sky().plan(None), [7.0], 3, 0.05, np.random.default_rng(0))
    with pytest.raises(ConfigError, match=r"study.images=path is not possible here; give grid or recorded"):
        Rotations(images=Source.path)
    with pytest.raises(
        ConfigError, match=r"study.room='a' is about names of recorded images; give study.images=recorded"
    ):
        Rotations(room="a")
    with pytest.raises(DataError, match=r"an image of a pair could not be read: 3.png: cannot be read; take it out"):
        run(Rotations(distances_m=[0], pairs=1), parts_of(unread=True))
    mute = Parts(sensor=Sky(), descriptor=Marks(), distance=Aligned("nothing"))
    with pytest.raises(ConfigError, match="the distance 'distance' of descriptor gives no rotation; choose another"):
        run(Rotations(distances_m=[0], pairs=1), mute)
