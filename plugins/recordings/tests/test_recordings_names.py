"""Poses come out of file names: every preset on a tiny folder, patterns of one's own, and what can be wrong."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import GridPoses, RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_recordings import Folder
from omnilab_recordings.poses.filename_poses import PRESETS, Naming, positions_of


@pytest.fixture
def write_names(tmp_path):
    def write(names):
        for name in names:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(tmp_path / name), np.full((16, 16), 90, np.uint8))
        return str(tmp_path)

    return write


# preset, settings, names, and where they were taken: x, y, z in metres, heading in degrees
SETS = [
    ("bielefeld", {}, {"original/pos_0_0.pgm": (0, 0, 0, 0), "original/pos_9_16.pgm": (2.7, 4.8, 0, 0)}),
    ("moeller", {"spacing_m": 0.5}, {"corridor_02_07.pgm": (1, 3.5, 0, 0), "corridor_00_01.pgm": (0, 0.5, 0, 0)}),
    ("umh_altitude", {}, {
        "loc1/h1.png": (1, 0, 1.25, 0), "loc1/h8.png": (1, 0, 2.30, 0), "loc11/h2.png": (11, 0, 1.40, 0)}),
    ("umh_altitude", {"lowest_m": 0.5, "height_step_m": 0.1, "spacing_m": 2.0}, {
        "3_0.png": (6, 0, 0.5, 0), "3_5.png": (6, 0, 1.0, 0)}),
    ("umh_grid", {}, {"lab1.jpg": (0, 0, 0, 0), "lab8.jpg": (1.4, 0, 0, 0), "lab9.jpg": (0, 0.2, 0, 0), "lab64.jpg": (1.4, 1.4, 0, 0)}),
    ("quorum_v", {}, {"p_3_5.png": (1.2, 2.0, 0, 0), "p_0_5.png": (0, 2.0, 0, 0)}),
    ("cold", {}, {
        "t1152637022.476384_x0.250000_y-1.500000_a1.570796.jpeg": (0.25, -1.5, 0, 90),
        "t1152637022.676384_x0.250000_y-1.500000_a-0.785398.jpeg": (0.25, -1.5, 0, -45)}),
    ("utm", {}, {
        "@0543256.96@4178906.70@10@S@037.75@-122.50@pano-7@@90@@@@201311@@.jpg": (543256.96, 4178906.70, 0, 0),
        "@0543256.96@4178906.70@10@S@037.75@-122.50@pano-7@@0@@@@201311@@.jpg": (543256.96, 4178906.70, 0, 90)}),
    ("utm", {}, {"@100.5@200@whatever@.jpg": (100.5, 200, 0, 0), "@101@200@else@.jpg": (101, 200, 0, 0)}),
]  # fmt: skip


@pytest.mark.parametrize(("preset", "settings", "names"), SETS)
def test_a_preset_reads_names(write_names, preset, settings, names):
    sensor = Folder(write_names(names), names=preset, **settings)
    plan = sensor.plan(RecordedPoses())
    for key, T in zip(plan.keys, plan.T_world_camera, strict=True):
        x, y, z, heading = names[key]
        assert T[:3, 3] == pytest.approx([x, y, z], abs=1e-9)
        assert wrap_angle(heading_of(T) - np.deg2rad(heading)) == pytest.approx(0, abs=1e-6)


def test_every_preset_is_tried():
    assert {preset for preset, *_ in SETS} == set(PRESETS)


def test_stamps_are_exact_and_may_tell_images_of_one_pose_apart(write_names):
    names = ["t1152637022.476384_x1.0_y2.0_a0.0.jpeg", "t1152637022.676384_x1.0_y2.0_a0.0.jpeg"]
    sensor = Folder(write_names(names), names="cold", circle_px=[8, 8, 7])
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.stamps_ns.tolist() == [1152637022476384000, 1152637022676384000]


def test_a_numbered_set_is_a_grid(write_names):
    sensor = Folder(write_names([f"office_{i:03d}.png" for i in range(5, 69)]), names="umh_grid")
    assert len(sensor.plan(GridPoses(every=2))) == 16
    assert len(sensor.plan(GridPoses(step_m=0.4, extent_m=(20, 20)))) == 16
    narrow = Folder(sensor.path, names="umh_grid", columns=4)
    assert narrow.plan(RecordedPoses()).T_world_camera[4, :3, 3] == pytest.approx([0, 0.2, 0])


@given(st.integers(-999, 999), st.integers(-999, 999), st.floats(-720, 720))
def test_a_pattern_of_ones_own_in_any_unit(x_cm, y_mm, yaw):
    how = Naming(r"x(?P<x_cm>-?\d+)_y(?P<y_mm>-?\d+)_h(?P<height_m>[\d.]+)_(?P<yaw_deg>[-\d.e]+)\.png")
    found = positions_of([f"run/x{x_cm}_y{y_mm}_h1.5_{yaw!r}.png"], how)
    assert found.position_m[0] == pytest.approx([x_cm / 100, y_mm / 1000, 1.5])
    assert abs(wrap_angle(heading_of(found.R_world_robot[0]) - np.deg2rad(yaw))) < 1e-9


@pytest.mark.parametrize(("settings", "sentence"), [
    ({"names": "bielfeld"}, r"'bielfeld' is no preset \(did you mean bielefeld\?\); there is bielefeld, .*utm"),
    ({"names": "(?P<ix>\\d+"}, r"no regular expression \(.*\); mend it"),
    ({"names": r"(?P<yaw_degree>\d+)_"}, r"group 'yaw_degree' \(name it yaw_deg \(counter-clockwise from \+x\)\); it may be ix, iy"),
    ({"names": r"(?P<yaw_deg>\d+)_"}, r"gives no position"),
    ({"names": "x" * 290 + r"(?P<ix>\d+)_"}, r"has 302 characters; .* at most 300"),
    ({"names": r"(?P<ix>\d+)_"}, r"group ix, so spacing_m=None cannot be; give sensor\.spacing_m above 0"),
    ({"names": r"(?P<i>\d+)_", "spacing_m": 0.1}, r"group i, so columns=None"),
    ({"names": "bielefeld", "spacing_m": -1.0}, r"spacing_m=-1 is out of range"),
    ({"names": "cold", "spacing_m": 1.0}, r"spacing_m=1\.0 is of no use: names='cold' has no ix or iy or i"),
    ({"columns": 8}, r"columns=8 is of no use without names"),
])  # fmt: skip
def test_names_that_cannot_be_meant(settings, sentence):
    with pytest.raises(ConfigError, match=sentence):
        Folder("x", **settings)


@pytest.mark.parametrize(("files", "names", "sentence"), [
    (["a_1_2.png", "b.png", "c.png"], "bielefeld", r"2 of 3 image names do not match names=.* \(b\.png, c\.png\); .*narrow sensor\.pattern"),
    (["@1@2@3@4@5@6@7@8@90@.jpg", "@2@2@3@4@5@6@7@8@@.jpg"], "utm", r"1 of 2 image names do not have a value for heading_deg \(@2@2"),
    (["1403636579763555584_1.png"], r"(?P<stamp_s>\d+)_(?P<x_m>\d+)", r"stamp_s='1403636579763555584', which is too large for seconds and looks like nanoseconds"),
    (["@1@two@.jpg"], "utm", r"has y_m='two', which is no number"),
    (["a_1_2.png", "b_1_2.png"], "bielefeld", r"a_1_2\.png and b_1_2\.png have one pose by their names; .*\?P<view>"),
])  # fmt: skip
def test_names_that_give_no_pose(write_names, files, names, sentence):
    with pytest.raises(DataError, match=sentence):
        Folder(write_names(files), names=names).plan(RecordedPoses())


@pytest.mark.parametrize(("names", "sentence"), [
    (r"(?P<x_m>\d+)_(?P<x_cm>\d+)", "gives the x twice, as x_m and x_cm; leave one out"),
    (r"(?P<yaw_rad>\d+)_(?P<heading_deg>(?P<x_m>\d+))", "gives the heading twice, as yaw_rad and heading_deg"),
])  # fmt: skip
def test_names_that_give_one_thing_twice(write_names, names, sentence):
    with pytest.raises(ConfigError, match=sentence):
        Folder(write_names(["a_1_2.png"]), names=names).plan(RecordedPoses())


def test_names_and_a_positions_file_are_one_too_many(write_names, tmp_path):
    sensor = Folder(write_names(["a_1_2.png"]), names="bielefeld")
    (tmp_path / "positions.csv").write_text("image,x_m,y_m\na_1_2.png,7,7\n")
    with pytest.raises(ConfigError, match=r"positions\.csv and by sensor\.names; give sensor\.positions=null"):
        sensor.plan(RecordedPoses())
    plan = Folder(sensor.path, names="bielefeld", positions=None).plan(RecordedPoses())
    assert plan.T_world_camera[0, :2, 3] == pytest.approx([0.3, 0.6])
