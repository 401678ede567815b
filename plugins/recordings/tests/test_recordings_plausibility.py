"""Poses that may be meant otherwise than they are read, by the run and by `omnilab check`; advice that is followed."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnilab.api import RecordedPoses
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_recordings import Folder
from omnilab_recordings.checks.command import check
from omnilab_recordings.checks.turns import compare_turns, turn_between
from omnilab_recordings.folder import HeadingSense
from omnilab_recordings.questions import questions

CIRCLE = [32, 32, 30]
COUNT = 18


def picture(heading, mirrored=False, seed=0):
    """What a camera of that heading sees of far things, in a circle of 30 pixels."""
    v, u = np.indices((65, 65))
    bearing = np.arctan2(32 - v, u - 32) + heading
    rng = np.random.default_rng(seed)
    waves = (np.cos(k * bearing + rng.uniform(0, 6)) / k**0.5 for k in range(1, 12))
    grey = np.clip(128 + 30 * sum(waves), 20, 235).astype(np.uint8)
    return np.ascontiguousarray(grey[:, ::-1]) if mirrored else grey


@pytest.fixture
def write(write_recording):
    """Write pictures of random headings at random places; `written` says how these stand in a column."""

    def write(column, written, mirrored=False, headings=None, seed=1):
        rng = np.random.default_rng(seed)
        headings = rng.uniform(-np.pi, np.pi, COUNT) if headings is None else headings
        rows = [
            f"img-{i}.png,{x:.3f},{y:.3f},{written(h):.6f}"
            for i, (h, (x, y)) in enumerate(zip(headings, rng.uniform(0, 3, (COUNT, 2)), strict=True))
        ]
        write_recording([picture(h, mirrored) for h in headings], rows, f"image,x_m,y_m,{column}")
        return headings

    return write


def folder(path, **given):
    return Folder(str(path), circle_px=CIRCLE, **given)


def heading_errors_deg(sensor, headings):
    found = heading_of(sensor.plan(RecordedPoses()).T_world_camera)
    return np.rad2deg(np.abs(wrap_angle(found - headings)))


@pytest.mark.parametrize(("column", "written"), [
    ("yaw_deg", np.rad2deg), ("yaw_rad", float), ("heading_deg", lambda h: 90 - np.rad2deg(h)),
])  # fmt: skip
def test_headings_as_they_are_documented_raise_no_question(write, tmp_path, caplog, column, written):
    headings = write(column, written)
    assert questions(folder(tmp_path)) == []
    assert heading_errors_deg(folder(tmp_path), headings).max() < 0.01
    assert caplog.messages == []


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 999), st.sampled_from([0.02, 0.05, 1.0, 6.3]))
def test_no_robot_with_headings_in_degrees_is_asked_for_radians(write, tmp_path, seed, spread):
    write("yaw_deg", np.rad2deg, headings=np.random.default_rng(seed).uniform(-spread, spread, COUNT) / 2, seed=seed)
    assert questions(folder(tmp_path)) == []


def test_headings_that_run_clockwise(write, tmp_path, caplog):
    headings = write("yaw_deg", lambda h: -np.rad2deg(h))
    folder(tmp_path).plan(RecordedPoses())
    (said,) = caplog.messages
    assert said.startswith(
        f"{tmp_path / 'positions.csv'}: headings turn against the pictures (16 pairs of neighbours agree to 1.00"
    )
    assert said.endswith(
        "; if headings run clockwise, give sensor.headings=clockwise; if pictures are mirrored, sensor.mirrored=true"
    )
    caplog.clear()
    followed = folder(tmp_path, headings=HeadingSense.clockwise)
    assert heading_errors_deg(followed, headings).max() < 0.01
    assert caplog.messages == questions(folder(tmp_path, headings=HeadingSense.counterclockwise)) == []


def test_pictures_that_are_mirrored(write, tmp_path):
    write("yaw_deg", np.rad2deg, mirrored=True)
    (said,) = questions(folder(tmp_path))
    assert said.endswith("if pictures are mirrored, sensor.mirrored=true")
    assert questions(folder(tmp_path, mirrored=True)) == []


def test_degrees_in_a_column_of_radians(write, tmp_path):
    headings = write("yaw_rad", np.rad2deg)
    (question,) = questions(folder(tmp_path))
    assert (
        "numbers in yaw_rad are large for radians; if they are degrees, name it yaw_deg: then they turn as" in question
    )
    table = (tmp_path / "positions.csv").read_text().replace("yaw_rad", "yaw_deg")
    (tmp_path / "positions.csv").write_text(table)
    assert questions(folder(tmp_path)) == []
    assert heading_errors_deg(folder(tmp_path), headings).max() < 0.01


@pytest.mark.parametrize(("column", "radians", "right"), [
    ("yaw_deg", float, "yaw_rad"), ("yaw_deg", lambda h: h % (2 * np.pi), "yaw_rad"),
    ("heading_deg", lambda h: wrap_angle(np.pi / 2 - h), None),
])  # fmt: skip
def test_radians_in_a_column_of_degrees(write, tmp_path, column, radians, right):
    headings = write(column, radians)
    (said,) = questions(folder(tmp_path))
    assert f"all numbers in {column} are as small as radians are; if they are radians, name it yaw_rad" in said
    assert "agree to 1.00" in said
    if right:
        table = (tmp_path / "positions.csv").read_text().replace(column, right)
        (tmp_path / "positions.csv").write_text(table)
        assert questions(folder(tmp_path)) == []
        assert heading_errors_deg(folder(tmp_path), headings).max() < 0.01


def test_headings_in_names(tmp_path):
    for i, heading in enumerate(np.random.default_rng(1).uniform(-np.pi, np.pi, COUNT)):
        cv2.imwrite(str(tmp_path / f"x{i % 5}_y{i // 5}_a{-heading:.4f}.png"), picture(heading))
    pattern = r"x(?P<x_m>\d+)_y(?P<y_m>\d+)_a(?P<yaw_rad>-?[\d.]+)\.png"
    (said,) = questions(folder(tmp_path, names=pattern))
    assert said.startswith("poses in names: headings turn against the pictures")
    assert questions(folder(tmp_path, names=pattern, headings=HeadingSense.clockwise)) == []


def test_clockwise_is_about_a_column_of_headings(write_recording, tmp_path):
    write_recording([picture(0)], ["img-0.png,0,0,0,0,0,1"], "image,x_m,y_m,qx,qy,qz,qw")
    with pytest.raises(DataError, match=r"headings=clockwise speaks of yaw_deg and yaw_rad, and qx, qy, qz, qw gives"):
        folder(tmp_path, headings=HeadingSense.clockwise).plan(RecordedPoses())


@pytest.fixture
def run_check(tmp_path, capsys, monkeypatch):
    """What the command says; nothing may stand on the other stream."""

    def run_check():
        monkeypatch.setattr("omnilab_recordings.checks.command.write_report_picture", lambda *_: None)
        check([str(tmp_path), "-o", str(tmp_path.parent / "c.png"), "--circle", *map(str, CIRCLE)])
        out, err = capsys.readouterr()
        assert err == ""
        return out

    return run_check


def test_pictures_without_anything_in_them_tell_nothing(write_recording, tmp_path, run_check):
    rows = [f"img-{i}.png,{i},0,{h:.3f}" for i, h in enumerate(np.random.default_rng(1).uniform(-3.1, 3.1, COUNT))]
    write_recording([np.full((65, 65), 90, np.uint8)] * COUNT, rows, "image,x_m,y_m,yaw_deg")
    assert questions(folder(tmp_path)) == []
    assert re.search(r"\? +headings +cannot tell: all numbers in yaw_deg are as small as radians", run_check())


def test_check_says_the_same_as_the_run(write, tmp_path, run_check):
    write("yaw_deg", lambda h: -np.rad2deg(h))
    assert questions(folder(tmp_path))[0] in run_check()
    write("yaw_deg", np.rad2deg)
    assert re.search(r"ok +headings +16 pairs of neighbours turn as their pictures do \(1\.00", run_check())


@pytest.mark.parametrize(("offset_deg", "line"), [
    (0, r"ok +travel +the path leads where the headings point"), (90, r"\? +travel +the path leads 90 degrees to the right of the headings: right if"),
    (-90, r"travel +the path leads 90 degrees to the left"),
])  # fmt: skip
def test_check_says_where_a_robot_drives(write_recording, run_check, offset_deg, line):
    angle = 2 * np.pi * np.arange(COUNT) / COUNT
    rows = [
        f"img-{i}.png,{np.sin(a):.4f},{-np.cos(a):.4f},{np.rad2deg(a) + offset_deg:.4f}" for i, a in enumerate(angle)
    ]
    write_recording([picture(a + np.deg2rad(offset_deg)) for a in angle], rows, "image,x_m,y_m,yaw_deg")
    assert re.search(line, run_check())


@given(st.floats(-np.pi, np.pi))
def test_a_turn_is_seen(turn):
    azimuth = 2 * np.pi * np.arange(512) / 512
    rows = [sum(np.cos(k * azimuth + k * k + row) for k in range(1, 20)) for row in range(4)]
    turned = [sum(np.cos(k * (azimuth + turn) + k * k + row) for k in range(1, 20)) for row in range(4)]
    assert abs(wrap_angle(turn_between(np.array(rows), np.array(turned)) - turn)) < 0.02


def test_turns_that_agree_with_nothing():
    pairs = np.stack([np.arange(12), np.arange(12) + 1], -1)
    rng = np.random.default_rng(0)
    found = compare_turns(rng.uniform(-3, 3, 12), rng.uniform(-3, 3, 13), None, pairs)
    assert found.better is None
    assert not found.agree


# --------------------------------------------------------------------------------------------------------------- grids
def positions_of(write_recording, xy, cells=None):
    header = "image,x_m,y_m" + ",ix,iy" * (cells is not None)
    rows = [f"img-{i}.png,{x:.2f},{y:.2f}" for i, (x, y) in enumerate(xy)]
    rows = rows if cells is None else [f"{row},{ix},{iy}" for row, (ix, iy) in zip(rows, cells, strict=True)]
    return questions(folder(write_recording([picture(0)] * len(xy), rows, header)))


def test_rounded_positions_are_no_grid(write_recording):
    (said,) = positions_of(write_recording, np.random.default_rng(2).integers(0, 40, (60, 2)) / 10)
    assert "grid at 0.1 m has an image at 58 of its" in said
    assert "form no grid; ask for all that was recorded" in said


def test_columns_that_contradict_the_positions(write_recording):
    cells = np.stack([np.arange(16) % 4, np.arange(16) // 4], -1)
    (said,) = positions_of(write_recording, cells * 0.5, np.random.default_rng(1).permutation(cells))
    assert "ix and iy contradict x and y (half the images lie over" in said


@pytest.mark.parametrize("cells", [
    np.stack([np.arange(20) % 5, np.arange(20) // 5], -1),
    np.stack([np.arange(12), np.zeros(12, int)], -1),
    np.stack([np.r_[np.arange(8), np.zeros(8, int)], np.r_[np.zeros(8, int), np.arange(8)]], -1),  # two corridors
])  # fmt: skip
def test_grids_that_are_some(write_recording, cells):
    noise = np.random.default_rng(1).normal(0, 0.05, cells.shape)
    assert positions_of(write_recording, cells * 0.5) == []
    assert positions_of(write_recording, cells * 0.5 + noise, cells) == []
