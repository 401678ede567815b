"""Poses that may be meant otherwise: found where they are, and never in a walk that a robot can have done."""

from __future__ import annotations

import shutil
import subprocess
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.geometry import heading_of, planar_poses, poses, quaternion_xyzw, rotation_of_quaternion, rotation_xyz
from omnilab.trajectory.columns import MATRIX, QUATERNION
from omnilab.trajectory.files import Trajectory, kitti_text, read_trajectory, tum_text
from omnilab.trajectory.plausibility import about_axes, about_headings, about_positions, warn

START = 1_700_000_000 * 10**9
all_headings = partial(about_headings, clockwise="give sensor.headings=clockwise")


def open_questions(path):
    return [*about_positions(path), *all_headings(path)]


def written(position, headings, stamps, turn):
    """A path, and its headings as the column of that name has them."""
    inverse = {("yaw_deg",): np.rad2deg, ("yaw_rad",): np.asarray, ("heading_deg",): lambda h: 90 - np.rad2deg(h)}
    return Trajectory(
        planar_poses(position, headings), stamps, turn, inverse[turn](headings) if turn in inverse else None
    )


def walk(seed=0, count=60, step_m=0.3, wiggle=0.5, offset=0.0, turn=("yaw_deg",), stamped=True):
    """A robot that drives ahead and turns as it likes; its headings are `offset` to the left of where it drives."""
    rng = np.random.default_rng(seed)
    travel = rng.uniform(-3, 3) + np.cumsum(rng.normal(0.1, wiggle, count))
    steps = step_m * np.stack([np.cos(travel), np.sin(travel), np.zeros(count)], -1)
    position = np.cumsum(steps, axis=0) + rng.normal(0, 5, 3)
    stamps = START + np.cumsum(rng.integers(10**8, 4 * 10**8, count)) if stamped else None
    return written(position, travel + offset, stamps, turn)


def circle(count=40, turn=("yaw_deg",), headings=lambda heading: heading, radius_m=2.0):
    """Once round, with headings that are written otherwise."""
    angle = 2 * np.pi * np.arange(count) / count
    position = radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], -1)
    return written(position, headings(angle + np.pi / 2), None, turn)


def moved(path, change):
    """The path with other positions (N, 3)."""
    T = path.T_world_camera.copy()
    T[:, :3, 3] = change(T[:, :3, 3])
    return Trajectory(T, path.stamps_ns, path.turn, path.numbers)


# ----------------------------------------------------------------------------------------------- nothing to ask about
@settings(deadline=None)
@given(
    st.integers(0, 10**6), st.integers(1, 120), st.floats(0.01, 2), st.floats(0, 3), st.floats(-3.14, 3.14),
    st.sampled_from([("yaw_deg",), ("yaw_rad",), ("heading_deg",), QUATERNION, MATRIX]), st.booleans(),
)  # fmt: skip
def test_a_robot_that_drives_raises_no_question(seed, count, step_m, wiggle, offset, turn, stamped):
    assert open_questions(walk(seed, count, step_m, wiggle, offset, turn, stamped)) == []


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 60), st.floats(0.05, 5), st.sampled_from([0.0, 1.0, 3.0, 90.0, 360.0]))
def test_grids_and_random_poses_raise_no_question(seed, count, spacing_m, spread_deg):
    rng = np.random.default_rng(seed)
    cells = np.stack([np.arange(count) % 8, np.arange(count) // 8, np.zeros(count)], -1)
    for position in (
        spacing_m * cells,
        rng.uniform(-4, 4, (count, 3)),
        np.zeros((count, 3)),
        rng.normal(0, 1e-3, (count, 3)),
    ):
        headings = np.deg2rad(rng.uniform(-spread_deg, spread_deg, count) / 2)
        path = written(position, headings, START + 10**8 * np.arange(count), ("yaw_deg",))
        assert open_questions(path) == []


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 60), st.sampled_from([QUATERNION, MATRIX]))
def test_cameras_in_any_attitude_raise_no_question(seed, count, turn):
    rng = np.random.default_rng(seed)
    R = rotation_of_quaternion(rng.normal(size=(count, 4)))
    assert open_questions(Trajectory(poses(rng.uniform(-9, 9, (count, 3)), R), None, turn)) == []
    ahead = rotation_xyz(-np.pi / 2, 0, 0)  # z ahead, as in optical frames
    path = walk(seed, count)
    optical = path.T_world_camera.copy()
    optical[:, :3, :3] = optical[:, :3, :3] @ rotation_xyz(0, 0, -np.pi / 2) @ ahead
    assert list(about_positions(Trajectory(optical, None, turn))) == []


@pytest.mark.parametrize("change", [
    lambda p: p + np.array([450_000, 5_600_000, 90]),  # a country's map
    lambda p: p * [1, 0, 1],  # to and fro
    lambda p: np.where(np.arange(len(p))[:, None] > 30, p + 9, p),  # carried elsewhere
    lambda p: p.round(1),
    lambda p: np.where(np.arange(len(p))[:, None] >= 55, p + 500, p),  # another site
    lambda p: p * 0.01 + [8.53, 52.02, 0],  # a slider, millimetre by millimetre
])  # fmt: skip
def test_other_paths_that_are_sound(change):
    assert open_questions(moved(walk(3), change)) == []


# -------------------------------------------------------------------------------------------------------------- asked
@pytest.mark.parametrize(("path", "sentence"), [
    (circle(headings=lambda h: -h), "headings turn against the path; if they run clockwise, give sensor.headings=clockwise; if not, x and y are swapped"),
    (circle(headings=lambda h: np.pi / 2 - h), "if they run clockwise, from north, name it heading_deg;"),
    (circle(turn=("heading_deg",), headings=lambda h: np.pi / 2 - h), "counter-clockwise that is, name it yaw_deg;"),
    (circle(turn=QUATERNION, headings=lambda h: -h), "turn them round .rotations may be from world to camera."),
    (moved(circle(), lambda p: p[:, [1, 0, 2]]), "headings turn against the path"),
    (circle(headings=lambda h: np.deg2rad(h % (2 * np.pi))), "all numbers in yaw_deg are as small as radians are; if they are radians, name it yaw_rad: then they turn with"),
    (circle(headings=lambda h: np.deg2rad((h + np.pi) % (2 * np.pi) - np.pi)), "name it yaw_rad:"),
    (circle(headings=np.deg2rad), "name it yaw_rad:"),  # beyond a turn
    (circle(turn=("yaw_rad",), headings=np.rad2deg), "numbers in yaw_rad are large for radians; if they are degrees, name it yaw_deg: then"),
    (circle(turn=("heading_deg",), headings=lambda h: np.pi / 2 - np.deg2rad((np.pi / 2 - h) % (2 * np.pi))), "all numbers in heading_deg"),
])  # fmt: skip
def test_headings_against_the_path(path, sentence):
    (question,) = all_headings(path)
    assert sentence.replace(".", "") in question.replace(".", "").replace("(", "").replace(")", "")


def test_headings_that_are_known_leave_the_axes():
    (question,) = about_axes(moved(circle(), lambda p: p * [1, -1, 1]))
    assert (
        question
        == "headings turn against the path, so x and y are swapped, or one of them is of the other sign: mend these columns"
    )
    assert list(about_axes(circle())) == []


@settings(deadline=None)
@given(st.integers(0, 10**6), st.floats(-3.1, 3.1))
def test_quaternions_with_the_real_part_first(seed, offset):
    path = walk(seed, 40, wiggle=0.6, offset=offset, turn=QUATERNION)
    x, y, z, w = quaternion_xyzw(path.T_world_camera).T
    wrong = poses(path.T_world_camera[:, :3, 3], rotation_of_quaternion(np.stack([w, x, y, z], -1)))
    found = list(about_positions(Trajectory(wrong, None, QUATERNION)))
    if np.median(wrong[:, 2, 2]) < 0.5:  # else it is seldom upright, and seldom tips over
        assert found == [next(about_positions(Trajectory(wrong, None, QUATERNION)))]
        assert "stay upright if the real part of the quaternions is the first" in found[0]
    mended = poses(path.T_world_camera[:, :3, 3], rotation_of_quaternion(np.stack([x, y, z, w], -1)))
    assert np.allclose(heading_of(mended), heading_of(path.T_world_camera))


@pytest.mark.parametrize(("path", "sentence"), [
    (moved(walk(1), lambda p: p * 1000), "neighbours lie 300 m apart; if positions are in millimetres"),
    (moved(walk(1, stamped=False), lambda p: p * 1000), "neighbours lie 300 m apart"),
    (moved(walk(1, count=400, step_m=0.03), lambda p: p * 1000), "the camera moves at"),
    (moved(walk(1), lambda p: (p * 100).round()), "name their columns x_mm, y_mm or x_cm, y_cm"),
    (moved(walk(1), lambda p: [8.53, 52.02, 0] + p * 1e-5), "degrees of longitude and latitude, project them"),
    (moved(walk(1, 400), lambda p: np.arange(len(p))[:, None] * [1.5e-4, 1e-4, 0] + np.array([8.53, 52.02, 0])), "degrees of longitude and latitude"),
    (moved(walk(1), lambda p: [-33.86, 151.2, 0] + p * 1e-5), "degrees of longitude and latitude"),
    (moved(walk(1), lambda p: np.where(np.arange(len(p))[:, None] == 7, p * 100 + 99, p)), "pose 8 of 60 lies at"),
    (moved(walk(1), lambda p: np.where(np.isin(np.arange(len(p)), [7, 20])[:, None], [-1234, 5, 0], p)), "2 of 60 poses lie at -1234, 5, 0 (number 8, say), "),
    (Trajectory(walk(1).T_world_camera, np.arange(60) // 2, ()), "times are 0.4915 nanoseconds apart"),
    (Trajectory(walk(1).T_world_camera, 10**5 * np.arange(60) + START // 1000, ()), "stamp_ms or stamp_us"),
    (Trajectory(walk(1).T_world_camera, np.arange(60), ()), "times are 1 nanoseconds apart; if they are in seconds"),
])  # fmt: skip
def test_positions_and_times_in_other_units(path, sentence):
    (question,) = about_positions(path)
    assert sentence in question


@pytest.mark.skipif(shutil.which("awk") is None, reason="the command is one of awk")
@pytest.mark.parametrize("name", ["a.kitti", "a.tum"])
def test_axes_of_a_camera_are_turned_by_the_command_that_is_proposed(tmp_path, name):
    path, C = walk(2, wiggle=0.8), np.eye(4)
    C[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    T = np.linalg.inv(C) @ path.T_world_camera @ C
    text = kitti_text(T) if name == "a.kitti" else tum_text(T, path.stamps_ns)
    (tmp_path / name).write_text(text)
    found = read_trajectory(tmp_path / name)
    (question,) = about_positions(found)
    command = question.partition(": ")[2].replace("OLD", name).replace("NEW", f"new-{name}")
    subprocess.run(command, shell=True, cwd=tmp_path, check=True)
    mended = read_trajectory(tmp_path / f"new-{name}")
    assert np.allclose(mended.T_world_camera, path.T_world_camera, atol=1e-4)
    assert open_questions(mended) == []


def test_a_run_is_told(caplog):
    warn("wheels.csv", circle(headings=lambda h: -h))
    assert caplog.messages[0].startswith(
        "wheels.csv: headings turn against the path; if they run clockwise, change their signs;"
    )
