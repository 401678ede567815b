"""Calibrations of other tools: what they describe is what OpenCV, or a closed form, makes of the same numbers."""

import json
import logging
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.cameras import BrownConradyCamera, KannalaBrandtCamera, OCamCamera, UnifiedCamera, load_camera, save_camera
from omnilab.cameras import files as camera_files
from omnilab.errors import ConfigError

DATA = Path(__file__).resolve().parents[3] / "shared/data"
K = np.array([[461.5, 0, 362.4], [0, 460.1, 246.2], [0, 0, 1.0]])
SIZE = {"width": 752, "height": 480}
PLANE = {"fx": 461.5, "fy": 460.1, "cx": 362.4, "cy": 246.2}
RADTAN = [-0.28, 0.07, 2e-4, 1.8e-5]
EQUI = [-0.0017, 0.0244, -0.0358, 0.0199]
MEI = {"xi": 1.47, "k1": -0.21, "k2": 0.6, "p1": -1e-3, "p2": 7e-4}
CAMCHAIN = f"""cam0:
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.07]
  - [-1.0, 0.0, 0.0, -0.01]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: {EQUI}
  distortion_model: equidistant
  intrinsics: [461.5, 460.1, 362.4, 246.2]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: omni
  distortion_coeffs: [-0.21, 0.6, -1e-3, 7e-4]
  distortion_model: radtan
  intrinsics: [1.47, 461.5, 460.1, 362.4, 246.2]
  resolution: [752, 480]
"""
CAMERA_INFO = f"""image_width: 752
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: {K.ravel().tolist()}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.28, 0.07, 2e-4, 1.8e-5, 1e-2]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""
KITTI_360 = """%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 752
image_height: 480
mirror_parameters:
   xi: 1.47
distortion_parameters:
   k1: -2.1000000000000002e-01
   k2: 0.6
   p1: -1e-3
   p2: 7e-4
projection_parameters:
   gamma1: 461.5
   gamma2: 460.1
   u0: 362.4
   v0: 246.2
"""


@pytest.fixture
def written(tmp_path):
    """`written(text, name)`: a file with that text."""

    def write(text, name="calibration.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


@pytest.fixture
def stored(tmp_path):
    """`stored(name, key=value)`: a file that OpenCV itself wrote."""

    def store(name="calibration.yml", **values):
        file = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            file.write(key, np.array(value, float) if isinstance(value, list) else value)
        file.release()
        return tmp_path / name

    return store


def seen():
    """Points (n, 3), right, down and forward."""
    return np.column_stack([np.random.default_rng(2).uniform(-0.45, 0.45, (60, 2)), np.ones(60)])


def shows(camera, expected):
    """Whether a camera that looks ahead shows the points where they are expected, and looks back to them."""
    points = seen()
    found = camera.pixels(points @ np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], float))
    assert np.isfinite(found).all()
    assert np.abs(found - expected).max() < 1e-9
    back = camera.directions(found) @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
    assert np.allclose(back[:, :2] / back[:, 2:], points[:, :2], atol=1e-9)
    return True


def pinhole(D):
    return cv2.projectPoints(seen(), np.zeros(3), np.zeros(3), K, np.array(D, float))[0][:, 0]


def fisheye(D):
    return cv2.fisheye.projectPoints(seen()[:, None], np.zeros(3), np.zeros(3), K, np.array(D))[0][:, 0]


def omni():
    """As OpenCV's omnidir has it, which is not in its wheel: the unit sphere, xi, k1, k2, p1, p2, K (Mei & Rives)."""
    X, Y, Z = (seen() / np.linalg.norm(seen(), axis=1, keepdims=True)).T
    x, y = X / (Z + MEI["xi"]), Y / (Z + MEI["xi"])
    D = np.array([MEI["k1"], MEI["k2"], MEI["p1"], MEI["p2"]])
    return cv2.projectPoints(np.column_stack([x, y, np.ones(60)]), np.zeros(3), np.zeros(3), K, D)[0][:, 0]


# ------------------------------------------------------------------------------------------------------------- Kalibr
def test_kalibr_s_equidistant_is_opencv_s_fisheye(written):
    camera = load_camera(written(CAMCHAIN), looks="ahead", entry="cam0")
    assert isinstance(camera, KannalaBrandtCamera)
    assert shows(camera, fisheye(EQUI))


@pytest.mark.parametrize("header", ["", "%YAML:1.0\n", "%YAML:1.0\n---\n", "%YAML 1.0\n# a comment\n"])
def test_kalibr_s_omni_is_mei_s_model(written, header):
    camera = load_camera(written(header + CAMCHAIN), looks="ahead", entry="cam1")
    assert camera == UnifiedCamera(**SIZE, **PLANE, **MEI, looks="ahead")
    assert shows(camera, omni())


def test_kalibr_s_radtan_is_a_pinhole_that_looks_ahead(written):
    text = CAMCHAIN[: CAMCHAIN.index("cam1")].replace("equidistant", "radtan").replace(str(EQUI), str(RADTAN))
    camera = load_camera(written(text))  # one camera: none need be named
    assert isinstance(camera, BrownConradyCamera)
    assert camera.looks == "ahead"
    assert shows(camera, pinhole(RADTAN))


def test_a_camera_of_euroc(written):
    text = f"""sensor_type: camera
T_BS: {{cols: 4, rows: 4, data: {np.eye(4).ravel().tolist()}}}
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [461.5, 460.1, 362.4, 246.2]
distortion_model: radial-tangential
distortion_coefficients: {RADTAN}
"""
    assert shows(load_camera(written(text, "sensor.yaml")), pinhole(RADTAN))


def test_of_several_cameras_one_is_asked_for(written):
    file = written(CAMCHAIN)
    sentence = "describes 2 camera\\(s\\), cam0, cam1; give entry=cam0 or entry=cam1"
    with pytest.raises(ConfigError, match=sentence):
        load_camera(file)
    with pytest.raises(ConfigError, match="cam0, cam1, and no cam7; give entry=cam0"):
        load_camera(file, entry="cam7")
    assert load_camera(file, entry="cam1").xi == 1.47


def test_what_is_not_used_is_said_once(written, caplog):
    camera_files._say_once.cache_clear()
    file = written(CAMCHAIN)
    with caplog.at_level(logging.WARNING, "omnilab"):
        for _ in range(3):
            load_camera(file, entry="cam0")
        load_camera(file, entry="cam1")
    assert [record.getMessage() for record in caplog.records] == [
        f"{file} has T_cam_imu, which is not used: where the camera was is said by the poses of its pictures"
    ]


# ------------------------------------------------------------------------------------------------------- OpenCV and ROS
@pytest.mark.parametrize("name", ["calibration.yml", "calibration.json"])
@pytest.mark.parametrize("D", [
    [*RADTAN, 0.01], [-0.1, 0.02, 1e-3, -2e-3, 0.003, 0.4, 0.05, 0.01], [*RADTAN, *[0.0] * 8], [*RADTAN, 0.01, *[0.0] * 9],
])  # fmt: skip
def test_opencv_s_pinhole(stored, name, D):
    file = stored(name, image_width=752, image_height=480, camera_matrix=K, distortion_coefficients=D)
    assert shows(load_camera(file), pinhole(D))


@pytest.mark.parametrize("word", ["fisheye_model", "distortion_model"])
def test_opencv_s_fisheye(stored, word):
    says = {"fisheye_model": 1, "distortion_model": "equidistant"}[word]
    file = stored(image_width=752, image_height=480, camera_matrix=K, distortion_coefficients=EQUI, **{word: says})
    assert shows(load_camera(file, looks="ahead"), fisheye(EQUI))


def test_opencv_s_omnidir(stored):
    D = [MEI["k1"], MEI["k2"], MEI["p1"], MEI["p2"]]
    file = stored(image_width=752, image_height=480, camera_matrix=K, distortion_coefficients=D, xi=MEI["xi"])
    assert shows(load_camera(file, looks="ahead"), omni())


def test_four_coefficients_may_be_of_two_models(stored):
    file = stored(image_width=752, image_height=480, K=K, D=RADTAN)
    with pytest.raises(
        ConfigError, match="k1, k2, p1, p2 of a pinhole, or k1 to k4 of a fisheye; give distortion=radtan"
    ):
        load_camera(file)
    assert shows(load_camera(file, distortion="radtan"), pinhole(RADTAN))
    assert shows(load_camera(file, distortion="equidistant", looks="ahead"), fisheye(RADTAN))
    with pytest.raises(ConfigError, match="distortion='brown' is not known; give radtan or equidistant"):
        load_camera(file, distortion="brown")


def test_a_stereo_pair_has_two_cameras_and_no_size(stored):
    file = stored(M1=K, D1=[*RADTAN, 0.0], M2=K + np.diag([1, 1, 0]), D2=[0.0] * 5)
    with pytest.raises(ConfigError, match="describes 2 camera\\(s\\), 1, 2; give entry=1 or entry=2"):
        load_camera(file)
    with pytest.raises(ConfigError, match=r"does not say of which size .*give sensor\.size_px="):
        load_camera(file, entry="1")
    assert shows(load_camera(file, entry="1", size=(752, 480)), pinhole([*RADTAN, 0]))
    assert load_camera(file, entry="2", size=(752, 480)).fx == 462.5


def test_ros_camera_info_saved_and_echoed(written):
    saved = load_camera(written(CAMERA_INFO))
    assert shows(saved, pinhole([*RADTAN, 0.01]))
    flat = K.ravel().tolist()
    for K_, D_ in (("K", "D"), ("k", "d")):  # ROS 1, ROS 2
        text = f"""header:
  stamp: {{sec: 1, nanosec: 2}}
  frame_id: camera
height: 480
width: 752
distortion_model: plumb_bob
{D_}: [-0.28, 0.07, 0.0002, 1.8e-05, 0.01]
{K_}: {flat}
binning_x: 0
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}}
---
"""
        assert load_camera(written(text)) == saved


def test_ros_rational_and_equidistant(written):
    rational = [-0.1, 0.02, 1e-3, -2e-3, 0.003, 0.4, 0.05, 0.01]
    text = CAMERA_INFO.replace("plumb_bob", "rational_polynomial").replace("cols: 5", "cols: 8")
    text = text.replace("[-0.28, 0.07, 2e-4, 1.8e-5, 1e-2]", str(rational))
    assert shows(load_camera(written(text)), pinhole(rational))
    text = CAMERA_INFO.replace("plumb_bob", "equidistant").replace("cols: 5", "cols: 4")
    text = text.replace("[-0.28, 0.07, 2e-4, 1.8e-5, 1e-2]", str(EQUI))
    assert shows(load_camera(written(text), looks="ahead"), fisheye(EQUI))


# ------------------------------------------------------------------------------------------ Camodocal, OCamCalib's Python
def test_kitti_360_s_mei(written):
    assert shows(load_camera(written(KITTI_360), looks="ahead"), omni())


def test_a_fisheye_of_more_than_180_degrees_is_seen_to_its_edge(written):
    """Numbers as KITTI-360's: 185 degrees, the circle touching the frame, to a millionth of a pixel and back."""
    numbers = {
        "xi": 2.2,
        "k1": 0.017,
        "k2": 1.65,
        "p1": 4e-4,
        "p2": 4e-4,
        "gamma1": 1336,
        "gamma2": 1336,
        "u0": 717,
        "v0": 706,
    }
    text = KITTI_360.replace("752", "1400").replace("480", "1400")
    for name, value in numbers.items():
        text = re.sub(rf"{name}: \S+", f"{name}: {value}", text)
    camera = load_camera(written(text), looks="up")
    v, u = np.mgrid[:1400:97, :1400:97]
    uv = np.stack([u, v], -1).reshape(-1, 2).astype(float)
    uv = uv[np.hypot(*(uv - [717, 706]).T) < 680]
    rays = camera.directions(uv)
    assert np.isfinite(rays).all()
    assert np.abs(camera.pixels(rays) - uv).max() < 1e-6
    assert rays[:, 2].min() < 0


def test_camodocal_s_pinholes_and_fisheye(written):
    plane = "projection_parameters:\n   fx: 461.5\n   fy: 460.1\n   cx: 362.4\n   cy: 246.2\n"
    lens = "distortion_parameters:\n   k1: -0.28\n   k2: 0.07\n   p1: 2e-4\n   p2: 1.8e-5\n"
    head = "%YAML:1.0\n\nmodel_type: PINHOLE\nimage_width: 752\nimage_height: 480\n"
    assert shows(load_camera(written(head + lens + plane)), pinhole(RADTAN))
    more = "   k3: 0.003\n   k4: 0.4\n   k5: 0.05\n   k6: 0.01\n"
    full = head.replace("PINHOLE", "PINHOLE_FULL") + lens + more + plane
    assert shows(load_camera(written(full)), pinhole([*RADTAN, 0.003, 0.4, 0.05, 0.01]))
    kb = "projection_parameters:\n" + "".join(f"   k{i + 2}: {k}\n" for i, k in enumerate(EQUI))
    kb += "   mu: 461.5\n   mv: 460.1\n   u0: 362.4\n   v0: 246.2\n"
    camera = load_camera(written(head.replace("PINHOLE", "KANNALA_BRANDT") + kb), looks="ahead")
    assert shows(camera, fisheye(EQUI))


OCAM = {
    "taylor_coefficient": [337.7, 0.0, -1.22e-3, 1.38e-6, -3.01e-9],
    "distortion_center": [544.0, 377.6], "stretch_matrix": [[1.0033, 1.5e-3], [-1.8e-3, 1.0]],
    "extrinsics_t": [[[1.0, 0.0, 0.0, 0.0]] * 3], "valid": [True],
}  # fmt: skip


def test_py_ocamcalib_by_its_own_equation(written):
    """cam2world: (X, Y) = A^-1 ((u, v) - center), in this order, and the ray (X, Y, f(rho))."""
    with pytest.raises(ConfigError, match=r"give sensor.size_px=\[WIDTH,HEIGHT\]"):
        load_camera(written(json.dumps(OCAM), "lens.json"))
    camera = load_camera(written(json.dumps(OCAM), "lens.json"), looks="ahead", size=(1032, 778))
    uv = np.random.default_rng(0).uniform([150, 50], [900, 700], (100, 2))
    X, Y = np.linalg.solve(np.array(OCAM["stretch_matrix"]), (uv - OCAM["distortion_center"]).T)
    rays = np.column_stack([np.polyval(OCAM["taylor_coefficient"][::-1], np.hypot(X, Y)), -X, -Y])
    assert np.allclose(camera.directions(uv), rays / np.linalg.norm(rays, axis=1, keepdims=True), atol=1e-12)
    assert np.allclose(camera.pixels(rays), uv, atol=1e-6)


def test_a_published_lens(written):
    file = DATA / "ocam_fisheye_calib/calibration_fisheye_1.json"
    if not file.is_file():
        pytest.skip(f"the published fisheye calibration is not at {file}")
    camera = load_camera(file, size=(1032, 778))
    assert isinstance(camera, OCamCamera)
    assert 300 < camera.circle.radius < 1000


def test_every_tool_s_camera_goes_through_camera_json(written, tmp_path):
    for entry in ("cam0", "cam1"):
        camera = load_camera(written(CAMCHAIN), entry=entry)
        save_camera(camera, tmp_path / "camera.json")
        assert load_camera(tmp_path / "camera.json") == camera
    save_camera(load_camera(written(CAMERA_INFO)), tmp_path / "camera.json")
    assert load_camera(tmp_path / "camera.json") == load_camera(written(CAMERA_INFO))
