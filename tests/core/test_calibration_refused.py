"""Files that describe no camera that is read: each is named for what it is; and numbers that make no camera."""

from __future__ import annotations

import json
import os
import re
import time
from contextlib import suppress
from dataclasses import asdict

import pytest

from omnilab.cameras import (
    BrownConradyCamera,
    ConicalMirror,
    CylindricalCamera,
    EllipticMirror,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    KannalaBrandtCamera,
    OCamCamera,
    ParabolicMirror,
    PinholeCamera,
    SphericalMirror,
    StereoCamera,
    UnifiedCamera,
    load_camera,
)
from omnilab.cameras.dual_fisheye import side_by_side
from omnilab.cameras.formats.camera_json import MODELS
from omnilab.errors import ConfigError, DataError

KALIBR = """cam0:
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  intrinsics: [461.5, 460.1, 362.4, 246.2]
  resolution: [752, 480]
"""
INFO = """image_width: 752
image_height: 480
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [461, 0, 362, 0, 460, 246, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0.1, 0, 0, 0]}
"""
MEI = """%YAML:1.0
---
model_type: MEI
image_width: 752
image_height: 480
mirror_parameters: {xi: 1.4}
distortion_parameters: {k1: 0.1, k2: 0, p1: 0, p2: 0}
projection_parameters: {gamma1: 400, gamma2: 400, u0: 376, v0: 240}
"""


@pytest.fixture
def refused(tmp_path):
    """`refused(content, name)`: the sentence about a file."""

    def refused(content, name="calibration.yaml", error=DataError, **given):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(error) as told:
            load_camera(file, **given)
        sentence = str(told.value)
        assert str(file) in sentence
        assert "\n" not in sentence
        return sentence.removeprefix(str(file)).strip()

    return refused


# -------------------------------------------------------------------------------------------------- named for what it is
@pytest.mark.parametrize(("content", "name", "what", "way"), [
    (b"#ROSBAG V2.0\n\x00\x01", "a.bag", "is a ROS 1 bag", "echo its camera_info into a YAML file"),
    (b"\x89MCAP0\r\n\x01", "a.mcap", "is an MCAP log", "camera_info"),
    (b"SQLite format 3\0" + bytes(90), "a.db3", "is an SQLite database \\(a ROS 2 bag, say\\)", "camera_info"),
    (b"MATLAB 5.0 MAT-file, Platform", "Omni_Calib_Results.mat", "is a MATLAB file", "export calib_results.txt"),
    (b"PK\x03\x04aaaa", "calibration.npz", "a zip archive", "write K and the coefficients as YAML"),
    (b"\x80\x04\x95\x10", "calibration.pkl", "a Python pickle, which is never read", "as YAML"),
    (b"\x1f\x8b\x08\x00", "calibrationdata.tar.gz", "is compressed by gzip", "ost.yaml"),
    (b"\x89PNG\r\n\x1a\n", "0.png", "is a PNG picture", "describes its camera"),
    (b"\x01\x02\x00\x03", "calibration.bin", "is .*binary", "give a camera.json"),
    ("<?xml version='1.0'?>\n<opencv_storage>\n</opencv_storage>", "c.xml", "is OpenCV's XML", "ends in .yml"),
    ("<?xml version='1.0'?>\n<sdf version='1.6'><world/></sdf>", "a.world", "is a Gazebo world", "camera_info"),
    ("<robot name='r'/>", "a.urdf", r"is a robot's description \(URDF\)", "camera_info"),
    ("<document><chunk/></document>", "a.xml", "is an XML file", "as YAML"),
    ("# Camera list with one line of data per camera:\n1 OPENCV_FISHEYE 64 48 1 1 3 2 0 0 0 0\n", "cameras.txt",
     "is COLMAP's cameras.txt", "OPENCV_FISHEYE a KannalaBrandtCamera, with 0.5 less"),
    ("1 SIMPLE_RADIAL 3072 2304 2559.81 1536 1152 -0.0204\n", "cameras.txt", "is COLMAP's cameras.txt", "camera.json"),
    ("P0: 7.188560000000e+02 0 6.07e+02 0\nP1: 1 2 3\n", "calib.txt", "is KITTI's calib file", "BrownConradyCamera"),
    ("KannalaBrandt 190.9 190.9 254.9 256.8 0.003 0.0007 -0.002 0.0002\n512 512\n", "camera.txt", "DSO's camera.txt", "camera.json"),
    ("# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n", "ost.txt", "is ROS's ost.txt", "give ost.yaml"),
    ("Calibration results \n====================\nCamera-system parameters:\n", "results-cam.txt", "report of Kalibr", "camchain.yaml"),
    ("%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera.fx: 190.9\n", "ORB.yaml", "is ORB-SLAM's settings", "camera.json"),
    ("%YAML:1.0\nimu: 1\ncam0_calib: \"cam0_mei.yaml\"\n", "vins.yaml", "a configuration of VINS-Fusion", "its cam0_calib names"),
    ("accelerometer_noise_density: 0.01\nupdate_rate: 200\n", "imu.yaml", "is of an IMU", "camera's file"),
    ("target_type: aprilgrid\ntagCols: 6\n", "april.yaml", "is Kalibr's target", "camchain.yaml"),
    ('{"value0": {"intrinsics": []}}', "calibration.json", "is a calibration of Basalt", "camera.json"),
    ('{"fl_x": 100, "frames": []}', "transforms.json", "is a transforms.json of NeRF tools", "camera.json"),
    ('{"sfm_data_version": "0.3", "intrinsics": []}', "sfm.json", "is OpenMVG's sfm_data", "camera.json"),
    ('{"a": 1, "b": 2}', "other.json", r"describes no camera that is read \(it holds a, b\)", "give a camera.json"),
    ("a: 1\n", "other.yaml", r"describes no camera that is read \(it holds a\)", "give a camera.json"),
    ("", "empty.yaml", "holds a NoneType and no camera", "give a camera.json"),
    ("just words", "words.yaml", "holds a str and no camera", "give a camera.json"),
    (MEI.replace("MEI", "SCARAMUZZA"), "s.yaml", "has model_type=SCARAMUZZA, which is not read", "calib_results.txt"),
    (KALIBR.replace("pinhole", "ds"), "ds.yaml", "has the model ds with radtan, which is not read", "omni-radtan"),
    (KALIBR.replace("radtan", "fov"), "fov.yaml", "has the distortion fov, which is not read", "radtan or equidistant"),
    (INFO.replace("plumb_bob", "thin_prism"), "i.yaml", "has distortion_model=thin_prism, which is not read", "plumb_bob"),
])  # fmt: skip
def test_what_is_not_read_is_named_with_the_way_round(refused, content, name, what, way):
    sentence = refused(content, name)
    assert re.search(what, sentence)
    assert way in sentence


@pytest.mark.parametrize(("text", "sentence"), [
    (KALIBR.replace("[752, 480]", "[752]"), "(cam0) has resolution=[752]; write 2 finite number(s)"),
    (KALIBR.replace("752", "752.5"), "(cam0) has resolution=752.5; write whole pixels"),
    (KALIBR.replace("461.5", "NaN"), "(cam0) has intrinsics=['NaN', 460.1, 362.4, 246.2]; write 4 finite number(s)"),
    (KALIBR.replace("461.5", ".inf"), "(cam0) has intrinsics=[inf, 460.1, 362.4, 246.2]; write 4 finite number(s)"),
    (KALIBR.replace("461.5", "-461.5"), ": fx=-461.5 is no focal length; give pixels, 0.01 or more"),
    (KALIBR.replace("362.4", "3624"), ": the axis at (3624, 246.2) lies outside the 752 x 480 image; give cx and cy"),
    (KALIBR.replace("intrinsics", "intrinsic"), "(cam0) has no intrinsics (did you mean intrinsic?); add it"),
    (KALIBR.replace("  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]\n", ""), "(cam0) has no distortion_coeffs"),
    (INFO.replace("461, 0, 362, 0, 460, 246, 0, 0, 1", "461, 0, 0, 0, 460, 0, 362, 246, 1"), "it is the transpose, as MATLAB"),
    (INFO.replace("461, 0, 362, 0, 460, 246, 0, 0, 1", "0, 0, 0, 0, 0, 0, 0, 0, 1"), "this camera was not calibrated"),
    (INFO.replace("461, 0, 362", "461, 2, 362"), "has the skew 2, which a pinhole of OpenCV has not"),
    (INFO.replace("rows: 3", "rows: 2"), "write 9 finite number(s)"),
    (INFO[: INFO.index("distortion_coefficients")], "has no distortion_coefficients; write [0, 0, 0, 0, 0] if the lens has no"),
    (INFO + "binning_x: 2\n", "is of pictures that are binned"),
    (INFO + "roi: {x_offset: 10, y_offset: 0, width: 100, height: 100}\n", "is of pictures that are cut (roi)"),
    (INFO.replace("[-0.2, 0.1, 0, 0, 0]", "[0, 0, 0, 0, 0, 0, 0, 0, 0.1, 0, 0, 0]").replace("cols: 5", "cols: 12"),
     "has coefficients of a thin prism or a tilted sensor"),
    (MEI.replace("gamma1", "gamma"), "(projection_parameters) has no gamma1 (did you mean gamma?)"),
    (MEI.replace("{xi: 1.4}", "1.4"), "has mirror_parameters=1.4; write names and numbers below it"),
])  # fmt: skip
def test_what_is_wrong_in_a_tool_s_file_is_said_by_its_key(refused, text, sentence):
    assert sentence in refused(text)


@pytest.mark.parametrize(("given", "sentence"), [
    ({"entry": "cam1"}, "describes 1 camera(s), cam0, and no cam1; give entry=cam0"),
    ({"distortion": "radtan"}, "leaves no such thing open; leave distortion out"),
])  # fmt: skip
def test_settings_that_do_not_fit_a_file(refused, given, sentence):
    assert sentence in refused(KALIBR, error=ConfigError, **given)


def test_a_lens_that_the_file_names_is_not_another(refused):
    assert "is of radtan; leave distortion out" in refused(INFO, error=ConfigError, distortion="equidistant")


# -------------------------------------------------------------------------------------------------------- unsafe content
@pytest.mark.parametrize(("text", "sentence"), [
    ("cam0: !!python/object/apply:os.system ['touch hacked']\n", "holds the tag 'tag:yaml.org,2002:python/object/apply:os.system'"),
    ("cam0: !include other.yaml\n", "holds the tag '!include'"),
    ("a: &a [1]\nb: [" + ", ".join(["*a"] * 100) + "]\n", "repeats itself by aliases"),
    ("a: " + "[" * 40 + "]" * 40 + "\n", "is nested too deeply"),
    ("a: &a {x: 1}\nb: {<<: *a}\n", "merges keys by <<"),
    ("a: 1\na: 2\n", "is not YAML (line 2 cannot be read)"),
    ("a: [1, 2\nb: 3\n", "is not YAML (line 2 cannot be read)"),
    ("a: 2001-99-99\nmodel_type: MEI\n", "is not YAML"),
    ("\t- a\n", "is not YAML (line 1 cannot be read)"),
])  # fmt: skip
def test_yaml_that_is_more_than_plain_values_is_refused(refused, text, sentence):
    assert sentence in refused(text)


def test_a_bomb_of_aliases_takes_no_time(refused):
    levels = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    start = time.perf_counter()
    assert "aliases" in refused("\n".join(["a0: &a0 [x, x]", *levels]))
    assert time.perf_counter() - start < 2


def test_large_files_folders_pipes_and_names_that_are_none(refused, tmp_path):
    assert "more than 1048576" in refused("a: 1\n" * 300_000)
    os.mkfifo(tmp_path / "pipe")
    for bad, what in ((tmp_path, "is a folder"), (tmp_path / "pipe", "is a pipe or a device, no file")):
        with pytest.raises(DataError, match=f"{what}, and no calibration that is read; give a camera.json"):
            load_camera(bad)
    with pytest.raises(DataError, match="its name holds the character NUL"):
        load_camera("a\0b")


# ----------------------------------------------------------------------------------------------------------- camera.json
FRAME = {"width": 64, "height": 48, "cx": 31.5, "cy": 23.5}
CAMERAS = [
    HyperbolicMirror(size=32), ParabolicMirror(size=32), SphericalMirror(size=32), EllipticMirror(size=32),
    ConicalMirror(size=32), StereoCamera(width=64, height=32, focal_px=40, baseline_m=0.1), CylindricalCamera(64, 32),
    EquirectangularCamera(64, 32), FisheyeCamera(**FRAME, focal_px=20), PinholeCamera(**FRAME, focal_px=40),
    UnifiedCamera(**FRAME, fx=12, fy=12, xi=0.9, k1=0.01), OCamCamera(**FRAME, polynomial=(-20.0, 0.0, 0.02)),
    KannalaBrandtCamera(**FRAME, fx=20, fy=20, k1=0.01), side_by_side(64, 32), BrownConradyCamera(**FRAME, fx=40, fy=40, k1=0.01, k4=0.02),
]  # fmt: skip
HUGE = 99999999999999999999999


def changed(camera, **settings):
    return json.dumps({"model": type(camera).__name__, **asdict(camera), **settings})


def test_every_model_is_tried():
    assert {type(camera).__name__ for camera in CAMERAS} == set(MODELS)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: type(camera).__name__)
def test_every_number_of_every_model_is_a_camera_s_or_refused(refused, tmp_path, camera):
    for name, value in asdict(camera).items():
        if isinstance(value, bool | str):
            continue
        for bad in (-HUGE, 10**400, 1e308, float("nan"), [], "1", True):
            given = [bad] if isinstance(value, list | tuple) else bad
            assert name in refused(changed(camera, **{name: given}), "camera.json")
        for odd in (0, -1, 1e-308, 1e11):  # some of which make a camera
            file = tmp_path / "camera.json"
            file.write_text(changed(camera, **{name: [odd] if isinstance(value, list | tuple) else odd}))
            with suppress(DataError):
                load_camera(file)


@pytest.mark.parametrize(("camera", "settings", "sentence"), [
    (0, {"model": ["HyperbolicMirror"]}, "has the model ['HyperbolicMirror']; give one of"),
    (0, {"model": {}}, "has the model {}; give one of"),
    (0, {"model": None}, "has the model None; give one of"),
    (0, {"b_mm": 0}, "a mirror with a=40.0, b=0, rim=41.0 mm has no hyperbola; give lengths above 0"),
    (0, {"b_mm": 1e-308}, "a HyperbolicMirror of these numbers sees nothing (size=32, crop=0.5"),
    (0, {"b_mm": HUGE}, "has b_mm=99999999999999999999999; write a number of a camera's size"),
    (0, {"size": 2_000_000_000}, "an image of 2000000000 x 2000000000 pixels is too large; give at most 65536 a side"),
    (9, {"focal_px": 1e308}, "has focal_px=1e+308; write a number of a camera's size, up to 1e+12"),
    (9, {"focal_px": 1e11}, "a PinholeCamera of these numbers sees nothing"),
    (9, {"width": HUGE}, "has width=99999999999999999999999"),
    (10, {"fx": 1e-308}, "fx=1e-308, fy=12, xi=0.9 is no camera; give fx, fy of 0.01 or more"),
    (10, {"xi": 1e9}, "a UnifiedCamera of these numbers sees nothing"),
    (5, {"baseline_m": 0}, "baseline_m=0 is no distance between cameras"),
    (8, {"k1": 0.01, "k2": 0, "k3": 0, "k4": 0},
     "has k1, k2, k3, k4, which a FisheyeCamera does not have; models that have: BrownConradyCamera, KannalaBrandtCamera"),
    (8, {"focal": 3}, "has the unknown key 'focal' (did you mean focal_px?); remove it"),
])  # fmt: skip
def test_a_camera_json_that_makes_no_camera(refused, camera, settings, sentence):
    assert sentence in refused(changed(CAMERAS[camera], **settings), "camera.json")


@pytest.mark.parametrize(("text", "sentence"), [
    ('{"model": "PinholeCamera", "width": 1, "width": 2}', "has the key 'width' twice; remove one"),
    ('{"model": ', "is not JSON (line 1, column 11)"),
    ('{"model": "PinholeCamera", "width": 64}', "lacks cx, cy, focal_px, height of a PinholeCamera; add what lacks"),
    ('{"width": 64}', "describes no camera that is read (it holds width)"),
    ("[1]", "holds a list and no camera"),
    ("{" + '"a": {' * 5000, "is not JSON"),
])  # fmt: skip
def test_json_that_is_no_camera(refused, text, sentence):
    assert sentence in refused(text, "camera.json")


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    (tmp_path / "camera.json").write_text("\ufeff" + changed(CAMERAS[9]), encoding="utf-8")
    assert load_camera(tmp_path / "camera.json") == CAMERAS[9]
