"""Cameras written for other tools: read back as the same, and projected as OpenCV and OCamCalib's C functions do."""

import cv2
import numpy as np
import pytest

from omnilab.cameras import (
    BrownConradyCamera,
    FisheyeCamera,
    HyperbolicMirror,
    KannalaBrandtCamera,
    OCamCamera,
    UnifiedCamera,
    load_camera,
)
from omnilab.cameras.calibration import refit
from omnilab.cameras.export import FORMS, export_camera
from omnilab.errors import ConfigError

SIZE = {"width": 752, "height": 480, "looks": "ahead"}
PLANE = {"fx": 261.5, "fy": 260.1, "cx": 362.4, "cy": 246.2}
KB = KannalaBrandtCamera(**SIZE, **PLANE, k1=-0.0017, k2=0.0244, k3=-1e-5, k4=0.0019)
MEI = UnifiedCamera(**SIZE, **PLANE, xi=1.2, k1=-0.21, k2=0.06, p1=-1e-3, p2=7e-4)
RADTAN = BrownConradyCamera(**SIZE, **PLANE, k1=-0.28, k2=0.07, p1=2e-4, p2=1.8e-5)
RATIONAL = BrownConradyCamera(**SIZE, **PLANE, k1=-0.1, k2=0.02, p1=1e-3, p2=-2e-3, k3=0.003, k4=0.4, k5=0.05, k6=0.01)
OCAM = OCamCamera(**SIZE, cx=362.4, cy=246.2, polynomial=(-210.0, 0, 2.6e-3, -7.7e-6, 2.7e-8), c=1.002, d=3e-3, e=-4e-3)
RAYS = np.column_stack([np.random.default_rng(2).uniform(-0.45, 0.45, (60, 2)), np.ones(60)])
K = np.array([[261.5, 0, 362.4], [0, 260.1, 246.2], [0, 0, 1.0]])


@pytest.mark.parametrize(("camera", "form"), [
    (OCAM, "ocamcalib"), (KB, "kalibr"), (MEI, "kalibr"), (RADTAN, "kalibr"), (KB, "opencv"), (MEI, "opencv"),
    (RADTAN, "opencv"), (RATIONAL, "opencv"), (KB, "ros"), (RADTAN, "ros"), (RATIONAL, "ros"),
])  # fmt: skip
def test_what_is_written_is_read_back_as_the_same(tmp_path, camera, form):
    file = tmp_path / ("calib_results.txt" if form == "ocamcalib" else "camera.yaml")
    export_camera(camera, file, form)
    assert load_camera(file, looks="ahead") == camera


def stored(tmp_path, camera):
    """K, the coefficients and xi that OpenCV itself reads."""
    export_camera(camera, tmp_path / "camera.yml", "opencv")
    file = cv2.FileStorage(str(tmp_path / "camera.yml"), cv2.FILE_STORAGE_READ)
    return [file.getNode(n).mat() for n in ("camera_matrix", "distortion_coefficients")], file.getNode("xi").real()


@pytest.mark.parametrize("camera", [RADTAN, RATIONAL])
def test_opencv_projects_its_file_of_a_pinhole_as_we_do(tmp_path, camera):
    (matrix, D), _ = stored(tmp_path, camera)
    expected = cv2.projectPoints(RAYS, np.zeros(3), np.zeros(3), matrix, D)[0][:, 0]
    assert np.abs(camera.image_points(RAYS) - expected).max() < 1e-6


def test_opencv_projects_its_file_of_a_fisheye_as_we_do(tmp_path):
    (matrix, D), _ = stored(tmp_path, KB)
    expected = cv2.fisheye.projectPoints(RAYS[:, None], np.zeros(3), np.zeros(3), matrix, D.ravel())[0][:, 0]
    assert np.abs(KB.image_points(RAYS) - expected).max() < 1e-6


def test_opencv_s_omnidir_is_the_sphere_and_its_pinhole(tmp_path):
    """Its own function is in no wheel; the plane and its distortion are projectPoints'."""
    (matrix, D), xi = stored(tmp_path, MEI)
    X, Y, Z = (RAYS / np.linalg.norm(RAYS, axis=1, keepdims=True)).T
    plane = np.column_stack([X / (Z + xi), Y / (Z + xi), np.ones(60)])
    expected = cv2.projectPoints(plane, np.zeros(3), np.zeros(3), matrix, D)[0][:, 0]
    assert np.abs(MEI.image_points(RAYS) - expected).max() < 1e-6


def test_ocamcalib_s_functions_do_as_we_do(tmp_path):
    """cam2world and world2cam of ocam_functions.c, by the numbers of the file."""
    export_camera(OCAM, tmp_path / "calib_results.txt", "ocamcalib")
    lines = [line for line in (tmp_path / "calib_results.txt").read_text().splitlines() if line and line[0] != "#"]
    (_, *pol), (_, *invpol), (xc, yc), (c, d, e), (height, width) = ([float(w) for w in line.split()] for line in lines)
    assert (height, width) == (480, 752)
    rays = OCAM.rays(OCAM.image_points(RAYS))
    down, right, toward = rays[:, 1], rays[:, 0], -rays[:, 2]  # their x, y, z
    norm = np.hypot(down, right)
    rho = np.polyval(invpol[::-1], np.arctan(toward / norm))
    x, y = down / norm * rho, right / norm * rho
    assert np.abs(np.column_stack([x * e + y + yc, x * c + y * d + xc]) - OCAM.image_points(RAYS)).max() < 2e-3
    row, column = OCAM.image_points(RAYS)[:, ::-1].T
    x, y = np.linalg.inv([[c, d], [e, 1]]) @ [row - xc, column - yc]
    back = np.column_stack([y, x, -np.polyval(pol[::-1], np.hypot(x, y))])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    assert np.abs(back - rays).max() < 1e-12


def test_a_lens_without_coefficients_is_one_whose_are_zero(tmp_path):
    lens = FisheyeCamera(**SIZE, cx=362.4, cy=246.2, focal_px=200.0)
    export_camera(lens, tmp_path / "camera.yaml", "kalibr")
    again = load_camera(tmp_path / "camera.yaml", looks="ahead")
    assert np.abs(again.image_points(RAYS) - lens.image_points(RAYS)).max() < 1e-9


@pytest.mark.parametrize(("camera", "form", "sentence"), [
    (KB, "ocamcalib", "holds the polynomial, and no KannalaBrandtCamera; give --refit ocam"),
    (MEI, "ros", "holds equidistant, plumb_bob and rational_polynomial, and no UnifiedCamera; give --refit kannala_brandt"),
    (OCAM, "kalibr", "no OCamCamera; give --refit kannala_brandt"),
    (RATIONAL, "kalibr", "has no k3=0.003, k4=0.4, .*; give --to opencv"),
    (HyperbolicMirror(), "opencv", "no HyperbolicMirror"),
])  # fmt: skip
def test_what_a_form_cannot_hold_is_refused(tmp_path, camera, form, sentence):
    with pytest.raises(ConfigError, match=sentence):
        export_camera(camera, tmp_path / "file", form)
    assert not (tmp_path / "file").exists()
    assert form in FORMS


def test_a_camera_is_refitted_and_how_far_off_is_what_is_said():
    truth = KannalaBrandtCamera(width=640, height=480, cx=325.3, cy=236.8, fx=170.0, fy=171.0, k1=-0.02, k2=0.004)
    found = refit(truth, "ocam")
    rays = truth.rays(np.array([[325.3 + 150 * np.cos(a), 236.8 + 150 * np.sin(a)] for a in np.arange(0, 6, 0.5)]))
    off = np.linalg.norm(found.camera.image_points(rays) - truth.image_points(rays), axis=-1)
    assert off.max() <= found.largest_px < 1.5
    assert refit(truth, "kannala_brandt").largest_px < 1e-6
