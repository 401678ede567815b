"""The study `matching`: pairs, which matches agree, and what it reports, on points whose positions are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Circle, Frames, Motion, Parts, Plan, RandomPoses, Unusable
from omnilab.cameras import EquirectangularCamera, ImageCircle
from omnilab.cameras.base import azimuth_elevation
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses, poses, rotation_xyz, wrap_angle
from omnilab.posegraph.graph import vectors
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Matching
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.matching.pairs import agrees, pairs_at, planar_direction, relative

ANGLES = st.floats(-3, 3)
CAMERA = EquirectangularCamera(64, 32)
POINTS = np.random.default_rng(0).uniform([-9, -9, -1], [9, 9, 3], (200, 3))


def seen(T: Any) -> Any:
    """Unit directions (M, 3) of the points from a pose."""
    points = (POINTS - T[:3, 3]) @ T[:3, :3]
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@given(st.lists(ANGLES, min_size=6, max_size=6), st.floats(0.05, 3), st.integers(0, 99))
@settings(max_examples=30, deadline=None)
def test_all_matches_of_one_scene_agree_and_others_do_not(angles, length, seed):
    before, now = (rotation_xyz(*angles[k : k + 3]) for k in (0, 3))
    direction = np.random.default_rng(seed).normal(size=3)
    at = np.stack([np.zeros(3), length * direction / np.linalg.norm(direction)])
    T = poses(at, np.stack([before, now]))
    R, t = relative(T[0], T[1])
    p, q = seen(T[0]), seen(T[1])
    assert agrees(p, q, R, t, np.deg2rad(0.1)).all()
    assert not agrees(-p, q, R, t, np.deg2rad(0.1)).any()  # on the other side of the translation
    assert agrees(np.roll(p, 1, axis=0), q, R, t, np.deg2rad(0.1)).mean() < 0.2
    apart = np.arccos(np.clip((p * (q @ R.T)).sum(axis=1), -1, 1)) > 0.01
    assert not agrees(q @ R.T, p @ R, R, t, np.deg2rad(0.1))[apart].any()  # moved towards where it came from


@given(ANGLES, ANGLES, st.floats(0.05, 3))
@settings(max_examples=30, deadline=None)
def test_the_direction_of_exact_matches_is_exact(rotation, direction, length):
    T = planar_poses(
        np.array([[0, 0, 0], [length * np.cos(direction), length * np.sin(direction), 0]]), [0.0, rotation]
    )
    assert abs(wrap_angle(planar_direction(seen(T[0]), seen(T[1]), rotation) - direction)) < 1e-6


@given(st.integers(0, 99), st.integers(1, 5))
@settings(max_examples=20, deadline=None)
def test_pairs_are_as_far_apart_as_they_should_be_and_share_no_image(seed, count):
    at = np.random.default_rng(seed).uniform(0, 4, (80, 3))
    pairs = pairs_at(at, [0.5, 1.5], count)
    assert [pair.distance_m for pair in pairs] == [0.5] * count + [1.5] * count
    for distance in (0.5, 1.5):
        own = [pair for pair in pairs if pair.distance_m == distance]
        assert len({image for pair in own for image in pair[1:]}) == 2 * count
        apart = [np.linalg.norm(at[pair.before] - at[pair.now]) for pair in own]
        np.testing.assert_allclose(apart, distance, rtol=0.1)


def test_too_few_pairs_are_a_sentence():
    with pytest.raises(
        DataError, match=r"1 of study\.pairs=2 pairs of images are 1 m apart, give or take 10%; give a larger"
    ):
        pairs_at(np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]]), [1.0], 2)


@dataclass
class Points:
    """Random poses among the points; images are grey."""

    camera: Any = CAMERA
    missing: str = ""

    def plan(self, layout):
        count = layout.count if isinstance(layout, RandomPoses) else 60
        rng = np.random.default_rng(3)
        at = np.column_stack([rng.uniform(-2, 2, (count, 2)), np.ones(count)])
        return Plan([str(i) for i in range(count)], planar_poses(at, rng.uniform(-3, 3, count)))

    def frames(self, plan):
        for start in range(0, len(plan), 5):
            part = np.arange(start, min(start + 5, len(plan)))
            images = np.full((len(part), self.camera.height, self.camera.width), 90, np.uint8)
            keys = [plan.keys[i] for i in part]
            omitted = [self.missing] if self.missing else []
            yield Frames(images, keys, part, self.camera, part, plan.T_world_camera[part], omitted)

    def scene(self):
        return None


@dataclass
class Knowing:
    """Matches the points as they are, the last `wrong` of them with others; a motion that is off by `off_rad`."""

    wrong: int = 0
    off_rad: float = 0.0
    length: bool = True
    black: bool = False

    def extract(self, frames):
        return [Unusable("black") if self.black else T for T in frames.T_world_camera]

    def estimate(self, before, now, rng):
        (vector,) = vectors((np.linalg.inv(before) @ now)[None], planar=True)
        p, q = seen(before), seen(now)
        q[len(q) - self.wrong :] = -q[len(q) - self.wrong :]
        angles = [
            np.stack([azimuth_elevation(d)[0], (azimuth_elevation(d)[1] + np.pi / 3) * 1.5 / np.pi], -1) for d in (p, q)
        ]
        x, y, rotation = vector
        c, s = np.cos(self.off_rad), np.sin(self.off_rad)
        moved = [c * x - s * y, s * x + c * y] if self.length else [np.nan, np.nan]
        inliers = np.arange(len(p)) < len(p) - self.wrong
        return Motion(np.array([*moved, rotation + self.off_rad]), np.eye(3), "m", "", np.stack(angles, 1), inliers)


def report(odometries, study=None, sensor=None):
    study = study or Matching(distances_m=[0.5, 1.0], pairs=4, images=150)
    parts = Parts(sensor=sensor or Points(), odometries=odometries)
    found = study.run(parts, Recorder([]), np.random.default_rng(0))
    return found, {metric.name: metric.value for metric in found.metrics}


def test_it_counts_what_agrees_and_measures_what_is_off():
    _, metrics = report({"true": Knowing(), "half": Knowing(wrong=100), "off": Knowing(off_rad=0.1)})
    assert metrics["agreeing_true_0.5"] == 200
    assert metrics["agreeing_half_1"] == 100
    assert metrics["solved_true_1"] == 1
    assert metrics["solved_off_1"] == 0
    assert metrics["rotation_error_median_true_1"] == pytest.approx(0, abs=1e-4)
    for name in ("rotation", "direction"):
        assert metrics[f"{name}_error_median_off_0.5"] == pytest.approx(np.rad2deg(0.1), abs=1e-3)


def test_a_direction_without_a_length_is_that_of_the_inliers():
    _, metrics = report({"no_floor": Knowing(length=False, wrong=20)})
    assert metrics["direction_error_median_no_floor_1"] == pytest.approx(0, abs=1e-3)


def test_what_cannot_be_used_counts_as_nothing():
    found, metrics = report({"black": Knowing(black=True)})
    assert metrics["agreeing_black_1"] == metrics["solved_black_1"] == 0
    assert found.tables["pairs"]["failed"] == ["black"] * 8
    (metric,) = (m for m in found.metrics if m.name == "direction_error_median_black_1")
    assert np.isnan(metric.value)
    assert metric.note == "no pair has one"


def test_it_keeps_the_contract_of_studies():
    parts = Parts(sensor=Points(), odometries={"true": Knowing()})
    check_study(Matching(distances_m=[1.0], pairs=2, images=60, source=Source.recorded), parts)


def test_bad_input_is_a_sentence():
    with pytest.raises(ConfigError, match=r"study\.source=grid has no pairs at all distances; give random or recorded"):
        Matching(source=Source.grid)
    with pytest.raises(DataError, match=r"an image of a pair is missing: 3: unreadable; leave it out"):
        report({"true": Knowing()}, sensor=Points(missing="3: unreadable"))
    circle = ImageCircle(64, 64, Circle(31.5, 31.5, 30))
    with pytest.raises(
        DataError, match="a ImageCircle does not know where its pixels look, and matches cannot be compared"
    ):
        report({"true": Knowing()}, sensor=Points(camera=circle))
