"""Lenses with coefficients against OpenCV: the fisheye of Kannala & Brandt, the pinhole of Brown & Conrady."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.cameras import BrownConradyCamera, FisheyeCamera, KannalaBrandtCamera
from omnilab.cameras.distortion import turning_radius
from omnilab.errors import ConfigError

FRAME = {"width": 640, "height": 480, "cx": 330.0, "cy": 229.0}
K = np.array([[180, 0, 330], [0, 183, 229], [0, 0, 1.0]])
FISHEYE = KannalaBrandtCamera(**FRAME, fx=180, fy=183, k1=0.02, k2=-0.005, k3=0.003, k4=-0.0006, looks="ahead")
RATIONAL = {"k1": 0.93, "k2": 0.166, "p1": -2.4e-5, "p2": -1.4e-5, "k3": 0.0029, "k4": 1.33, "k5": 0.436, "k6": 0.0276}
TO_CAMERA = np.array(
    [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float
)  # right, down, forward in the frame of one that looks ahead
small = st.floats(-0.02, 0.02)


def points(seed, widest=2.0):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-widest, widest, (80, 2)), np.ones((80, 1))], -1)


def matches(camera, expected, seen, least=20):
    """What a camera projects points (n, 3), given as (right, down, forward), to, where it shows them."""
    found = camera.pixels(seen @ TO_CAMERA.T)
    shown = np.isfinite(found).all(-1)
    assert shown.sum() >= least
    assert np.abs(found[shown] - expected[shown]).max() < 1e-9
    inside = ((expected >= 0) & (expected <= [639, 479])).all(-1)
    near = np.hypot(*(expected - [330, 229]).T) < 0.97 * camera.circle.radius
    assert shown[inside & near & (np.abs(seen[:, :2]).max(-1) < 0.8)].all()
    back = camera.directions(found[shown]) @ TO_CAMERA
    assert np.allclose(back, seen[shown] / np.linalg.norm(seen[shown], axis=-1, keepdims=True), atol=1e-9)


# ------------------------------------------------------------------------------------------------- Kannala and Brandt
@given(small, small, small, small, st.integers(0, 99))
def test_the_fisheye_projects_as_opencv_s(k1, k2, k3, k4, seed):
    seen = points(seed)
    camera = KannalaBrandtCamera(**FRAME, fx=180, fy=183, k1=k1, k2=k2, k3=k3, k4=k4, skew=1.5, looks="ahead")
    D = np.array([k1, k2, k3, k4])
    expected = cv2.fisheye.projectPoints(seen[:, None], np.zeros(3), np.zeros(3), K, D, alpha=1.5 / 180)[0][:, 0]
    matches(camera, expected, seen)


def test_rays_are_those_of_opencv():
    uv = np.random.default_rng(5).uniform([60, 60], [600, 420], (200, 2))
    D = np.array([FISHEYE.k1, FISHEYE.k2, FISHEYE.k3, FISHEYE.k4])
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-15)
    plane = cv2.fisheye.undistortPoints(uv[:, None], K, D, criteria=criteria)[:, 0]
    front = (np.hypot(*plane.T) < 5) & (np.abs(plane) < 5).all(-1)
    found = (FISHEYE.directions(uv) @ TO_CAMERA)[front]
    assert front.sum() > 100
    assert np.allclose(found[:, :2] / found[:, 2:], plane[front], atol=1e-8)


def test_without_coefficients_it_is_the_equidistant_fisheye():
    frame = {"width": 501, "height": 501, "cx": 250, "cy": 250, "looks": "up"}
    plain, same = FisheyeCamera(**frame, focal_px=90), KannalaBrandtCamera(**frame, fx=90, fy=90)
    directions = np.random.default_rng(1).normal(size=(300, 3))
    assert np.allclose(plain.pixels(directions), same.pixels(directions), atol=1e-9, equal_nan=True)
    assert same.largest_angle_rad == np.pi


def test_it_sees_behind_itself():
    angle = np.deg2rad(120)
    at = KannalaBrandtCamera(**FRAME, fx=90, fy=90, k1=0.01, looks="up").pixels(
        np.array([np.sin(angle), 0, np.cos(angle)])
    )
    assert np.allclose(at, [330 + 90 * angle * (1 + 0.01 * angle**2), 229])


@pytest.mark.parametrize(("k1", "largest"), [(-0.1, np.sqrt(1 / 0.3)), (-1.0, np.sqrt(1 / 3)), (0.1, np.pi)])
def test_there_are_no_rays_beyond_where_the_radius_stops_growing(k1, largest):
    camera = KannalaBrandtCamera(**{**FRAME, "width": 4000, "cx": 2000}, fx=180, fy=180, k1=k1, looks="up")
    assert camera.largest_angle_rad == pytest.approx(largest, abs=1e-12)
    radius = 180 * largest * (1 + k1 * largest**2)
    angles = np.linspace(0.01, 0.999, 50) * largest
    seen = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], -1)
    uv = camera.pixels(seen)
    shown = np.isfinite(uv).all(-1)
    assert shown.sum() > 40
    assert np.allclose(camera.directions(uv[shown]), seen[shown], atol=1e-6)
    assert np.isnan(camera.directions(np.array([2000 + 1.001 * radius, 229]))).all()
    if largest < np.pi:
        assert np.isnan(camera.pixels(np.array([np.sin(1.01 * largest), 0, np.cos(1.01 * largest)]))).all()


def test_straight_back_is_not_in_the_middle():
    for camera in (
        KannalaBrandtCamera(**FRAME, fx=50, fy=50, looks="up"),
        FisheyeCamera(**FRAME, focal_px=50, looks="up"),
    ):
        assert camera.pixels(np.array([0, 0, -1.0])) == pytest.approx([330 + 50 * np.pi, 229])
        assert camera.pixels(np.array([0, 0, 1.0])) == pytest.approx([330, 229])


# --------------------------------------------------------------------------------------------------- Brown and Conrady
@given(
    st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.05, 0.05)
)
def test_the_pinhole_projects_as_opencv_s(k1, k2, p1, p2, k3):
    seen = points(3, 1.0)
    camera = BrownConradyCamera(**FRAME, fx=400, fy=390, k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
    K = np.array([[400, 0, 330], [0, 390, 229], [0, 0, 1.0]])
    expected = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, np.array([k1, k2, p1, p2, k3]))[0][:, 0]
    found = camera.pixels(seen @ TO_CAMERA.T)
    shown = np.isfinite(found).all(-1)
    assert shown.sum() > 15
    assert np.abs(found[shown] - expected[shown]).max() < 1e-9
    back = camera.directions(found[shown]) @ TO_CAMERA
    certain = np.hypot(*seen[shown, :2].T) < 0.85 * turning_radius((k1, k2, p1, p2, k3))  # p1, p2 move the fold
    assert np.allclose(back[certain, :2] / back[certain, 2:], seen[shown][certain, :2], atol=1e-7)


def test_the_rational_model_is_opencv_s():
    seen = points(4, 0.9)
    camera = BrownConradyCamera(**FRAME, fx=300, fy=301, **RATIONAL)
    K = np.array([[300, 0, 330], [0, 301, 229], [0, 0, 1.0]])
    D = np.array([RATIONAL[name] for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")])
    expected = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    matches(camera, expected, seen)


@pytest.mark.parametrize("change", [{"k1": -0.5}, {"k3": -0.3}, {"k4": -0.4}, {"k1": 0.2, "k2": -0.3, "k3": 0.01}])
def test_a_pinhole_that_folds_ends_there(change):
    camera = BrownConradyCamera(**{**FRAME, "width": 4000, "cx": 2000}, fx=400, fy=400, **change)
    edge = camera.circle.radius
    tangents = np.linspace(0, 3, 3001)
    uv = camera.pixels(np.stack([np.ones(3001), -tangents, 0 * tangents], -1))[:, 0] - 2000
    shown = np.isfinite(uv)
    assert 100 < shown.sum() < 3001
    assert (np.diff(uv[shown]) > 0).all()
    assert shown[: shown.sum()].all()
    assert uv[shown].max() == pytest.approx(edge, rel=1e-3) if edge < 2000 else True
    if edge < 2000:
        assert np.isnan(camera.directions(np.array([2000 + 1.01 * edge, 229]))).all()


@pytest.mark.parametrize("camera", [FISHEYE, BrownConradyCamera(**FRAME, fx=300, fy=301, **RATIONAL)])
def test_flipped_pictures_have_a_flipped_camera(camera):
    uv = np.random.default_rng(5).uniform([150, 100], [500, 350], (50, 2))
    flipped = camera.flipped().directions(np.array([639, 0]) + uv * [-1, 1])
    assert np.allclose(flipped, camera.directions(uv) * [1, -1, 1], atol=1e-12)


@pytest.mark.parametrize(("make", "message"), [
    (lambda: KannalaBrandtCamera(**FRAME, fx=0, fy=1), "fx=0 is no focal length"),
    (lambda: KannalaBrandtCamera(**FRAME, fx=1, fy=float("nan")), "fy=nan is no focal length"),
    (lambda: KannalaBrandtCamera(**FRAME, fx=1, fy=1, k3=float("inf")), "k3=inf is no number of a camera"),
    (lambda: KannalaBrandtCamera(**FRAME, fx=1e300, fy=1), r"fx=1e\+300 is no number"),
    (lambda: BrownConradyCamera(**FRAME, fx=10**400, fy=1), "fx=an integer of 1329 bits is no number"),
    (lambda: BrownConradyCamera(**FRAME, fx=1, fy=1, p1=float("nan")), "p1=nan is no number"),
])  # fmt: skip
def test_numbers_that_make_no_camera_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
