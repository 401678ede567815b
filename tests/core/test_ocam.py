"""The OCam model and its file, against the toolbox's own equations and a calibrated lens."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from omnilab.cameras import OCamCamera, load_camera
from omnilab.errors import DataError

REAL = Path(__file__).resolve().parents[3] / "shared/data/ocam_fisheye_calib"
FILE = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world

5 -2.100e+02 0.000000e+00 2.6e-03 -7.7e-06 2.7e-08

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam

3 280.9 133.5 -0.14

#center: "row" and "column", starting from 0 (C convention)

250.5 310.25

#affine parameters "c", "d", "e"

1.002 0.003 -0.004

#image size: "height" and "width"

480 640
"""


@pytest.fixture
def calibration(tmp_path):
    def write(text):
        path = tmp_path / "calib_results.txt"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_file_gives_the_rays_of_cam2world(calibration):
    camera = OCamCamera.from_file(calibration(FILE))
    row, column = 120.0, 401.0
    x, y = np.linalg.inv([[1.002, 0.003], [-0.004, 1]]) @ [row - 250.5, column - 310.25]
    rho = np.hypot(x, y)
    z = -210 + 2.6e-3 * rho**2 - 7.7e-6 * rho**3 + 2.7e-8 * rho**4
    ray = np.array([y, -x, z]) / np.hypot(rho, z)  # x was down, y right; z towards the viewer, who looks down here
    assert np.allclose(camera.directions(np.array([column, row])), ray)
    assert (camera.width, camera.height, camera.circle.cx, camera.circle.cy) == (640, 480, 310.25, 250.5)


def test_a_polynomial_of_either_sign_looks_forward():
    frame = {"width": 640, "height": 480, "cx": 300, "cy": 200}
    toolbox, other = (OCamCamera(**frame, polynomial=p) for p in [(-210.0, 0, 0.001), (210.0, 0, -0.001)])
    assert np.array_equal(toolbox.directions(np.array([100, 90])), other.directions(np.array([100, 90])))
    assert np.allclose(toolbox.directions(np.array([300, 200])), [0, 0, -1])


def test_there_are_no_rays_where_the_angle_stops_growing():
    """With z = -100 - rho^2 / 100 the angle to the axis is largest at rho = 100: 26.6 degrees."""
    camera = OCamCamera(width=640, height=480, cx=320, cy=240, polynomial=(-100.0, 0, -0.01))
    assert camera.circle.radius == pytest.approx(100, abs=1)
    assert np.isnan(camera.directions(np.array([320.0, 345]))).all()
    assert np.isnan(camera.pixels(np.array([0.6, 0, -1]))).all()
    tangents = np.linspace(0.01, 0.4999, 200)  # rho / (100 + rho^2 / 100): a quadratic equation in rho
    rho = (1 - np.sqrt(1 - 4 * tangents**2)) * 50 / tangents
    u = camera.pixels(np.stack([tangents, 0 * tangents, -np.ones(200)], -1))[:, 0]
    assert np.allclose(u - 320, rho, atol=1e-5)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("5 -2.100e+02 0.000000e+00 2.6e-03 -7.7e-06 2.7e-08", "", "lacks the polynomial"),
    ("250.5 310.25", "", "lacks the centre"),
    ("1.002 0.003 -0.004", "", "lacks the affine"),
    ("480 640", "", "lacks the image's height"),
    ("5 -2.100e+02", "6 -2.100e+02", "polynomial's count.*'6 -2"),
    ("250.5 310.25", "250.5", "centre's row.*'250.5'"),
    ("250.5 310.25", "250.5 nan", "centre's row.*nan"),
    ("250.5 310.25", "250.5 left", "centre's row.*left"),
    ("480 640", "48 640", "calib_results.txt: the axis.*outside"),
    ("480 640", "480.5 640", "height and width.*480.5"),
    ("480 640", "480 640" + 70000 * " ", "more than 65536"),
])  # fmt: skip
def test_a_bad_file_is_told_by_its_line(calibration, old, new, message):
    assert old in FILE
    with pytest.raises(DataError, match=message):
        OCamCamera.from_file(calibration(FILE.replace(old, new)))


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "calib_results.txt")
    with pytest.raises(DataError, match="is a pipe or a device, no file"):
        OCamCamera.from_file(tmp_path / "calib_results.txt")


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(DataError, match=r"none\.txt cannot be read"):
        OCamCamera.from_file(tmp_path / "none.txt")


# ---------------------------------------------------------------------------------------------------------- a real lens
@pytest.fixture
def lens():
    if not REAL.is_dir():
        pytest.skip(f"the published fisheye calibration is not at {REAL}")
    found = json.loads((REAL / "calibration_fisheye_1.json").read_text(encoding="utf-8"))
    camera = load_camera(REAL / "calibration_fisheye_1.json", looks="ahead", size=(1032, 778))
    return camera, found["inverse_poly"]


def test_the_inverse_is_what_the_published_inverse_approximates(lens):
    camera, inverse = lens
    angle = np.linspace(0.02, 1.4, 50)
    polynomial = tuple(json.loads((REAL / "calibration_fisheye_1.json").read_text())["taylor_coefficient"])
    straight = OCamCamera(width=1032, height=778, cx=camera.cx, cy=camera.cy, polynomial=polynomial)
    uv = straight.pixels(np.stack([0 * angle, np.sin(angle), -np.cos(angle)], -1))
    shown = np.isfinite(uv).all(-1)
    assert shown.sum() > 30
    assert np.allclose(straight.cy - uv[shown, 1], np.polyval(inverse, angle[shown]), atol=0.01)


def test_straight_lines_of_a_chessboard_are_planes_of_rays(lens):
    import cv2

    camera, _ = lens
    picture = cv2.imread(str(REAL / "fish_1/Fisheye1_4.jpg"), cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCornersSB(picture, (7, 5))
    assert found
    off_plane = off_line = 0.0
    for line in corners.reshape(5, 7, 2):
        off_plane = max(off_plane, np.linalg.svd(camera.directions(line.astype(float)))[1][-1] / np.sqrt(7))
        off_line = max(off_line, np.linalg.svd(line - line.mean(0))[1][-1] / np.sqrt(7))
    assert off_line > 10  # pixels: in the picture they are bent
    assert off_plane < 0.6 / abs(camera.polynomial[0])  # radians: about half a pixel
