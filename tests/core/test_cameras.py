"""Every central camera: pixel, direction, pixel; the models against each other's closed forms and their physics."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Camera, Circle
from omnilab.cameras import (
    EIZOH_WIDE_70,
    THESIS_HALF,
    THESIS_WHOLE,
    CylindricalCamera,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    ImageCircle,
    OCamCamera,
    ParabolicMirror,
    PinholeCamera,
    UnifiedCamera,
)
from omnilab.errors import ConfigError, DataError
from omnilab.image import mirror_view, panorama

FRAME = {"width": 640, "height": 480, "cx": 330.0, "cy": 229.0}
MIRROR_POLYNOMIAL = (-145.0, 0.0, 2.2e-3, 1e-7)  # z = f(rho) of a mirror: the horizon at about 260 pixels
looks = st.sampled_from(["down", "up", "ahead"])
cameras = st.one_of(
    st.builds(ParabolicMirror, size=st.integers(32, 600), h_mm=st.floats(10, 40), rim_mm=st.floats(10, 60)),
    st.just(EIZOH_WIDE_70),
    st.builds(
        lambda fx, ratio, xi, skew, looks: UnifiedCamera(
            **FRAME, fx=fx, fy=ratio * fx, xi=xi, skew=skew, looks=looks, rim_px=0.9 * fx / max(xi**2 - 1, 0.1) ** 0.5
        ),
        st.floats(150, 400),
        st.floats(0.95, 1.05),
        st.floats(0, 2),
        st.floats(-2, 2),
        looks,
    ),
    st.builds(lambda f, looks: PinholeCamera(**FRAME, focal_px=f, looks=looks), st.floats(50, 2000), looks),
    st.builds(lambda f, looks: FisheyeCamera(**FRAME, focal_px=f, looks=looks), st.floats(120, 400), looks),
    st.builds(
        lambda c, d, e, looks: OCamCamera(**FRAME, polynomial=MIRROR_POLYNOMIAL, c=c, d=d, e=e, looks=looks),
        st.floats(0.9, 1.1),
        st.floats(-0.02, 0.02),
        st.floats(-0.02, 0.02),
        looks,
    ),
    st.builds(
        lambda fx, xi, k1, k2, p1, p2: UnifiedCamera(
            **FRAME, fx=fx, fy=1.02 * fx, xi=xi, skew=1.0, k1=k1, k2=k2, p1=p1, p2=p2
        ),
        st.floats(250, 400),
        st.floats(0.8, 1.2),
        st.floats(-0.2, 0.2),
        st.floats(-0.02, 0.05),
        st.floats(-0.01, 0.01),
        st.floats(-0.01, 0.01),
    ),
    st.builds(
        EquirectangularCamera,
        st.just(360),
        st.just(180),
        st.floats(-360, 360),
        st.booleans(),
        st.floats(-90, -10),
        st.floats(0, 90),
    ),
    st.builds(
        CylindricalCamera,
        st.just(512),
        st.just(128),
        st.floats(-360, 360),
        st.booleans(),
        st.just(-30.0),
        st.floats(0, 80),
    ),
)


def turned(degrees):
    return np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), 0])


@given(cameras, st.integers(0, 2**32 - 1))
def test_every_camera_is_the_inverse_of_itself(camera, seed):
    uv = np.random.default_rng(seed).uniform([-0.49, -0.49], [camera.width - 0.51, camera.height - 0.51], (60, 2))
    if camera.circle.radius > 0:  # not on the very rim
        away = np.hypot(*(uv - [camera.circle.cx, camera.circle.cy]).T)
        uv = uv[away < 0.98 * camera.circle.radius]
    d = camera.directions(uv)
    assert np.allclose(np.linalg.norm(d, axis=-1), 1)
    assert np.allclose(camera.pixels(2.5 * d), uv, atol=1e-5)


@given(cameras, st.integers(0, 2**32 - 1))
def test_every_direction_has_its_pixel_or_none(camera, seed):
    d = np.random.default_rng(seed).normal(size=(60, 3))
    uv = camera.pixels(d)
    shown = np.isfinite(uv).all(-1)
    assert np.array_equal(shown, np.isfinite(uv).any(-1))
    back = camera.directions(uv[shown])
    assert np.allclose(back, d[shown] / np.linalg.norm(d[shown], axis=-1, keepdims=True), atol=1e-6)


@given(cameras)
def test_every_camera_unwraps_within_its_elevations(camera):
    assert isinstance(camera, Camera)
    lowest, highest = camera.elevations_rad
    assert lowest < highest
    uv = camera.unwrap(np.zeros(9), np.linspace(0.01, 0.99, 9))
    assert np.isfinite(uv).all()
    z = camera.directions(uv)[:, 2]
    assert np.all(np.diff(z) > 0)
    assert np.all((z >= np.sin(lowest)) & (z <= np.sin(highest)))
    if highest - lowest > np.deg2rad(120):
        assert np.abs(z).max() <= np.sin(np.deg2rad(60))


@pytest.mark.parametrize("camera", [THESIS_HALF, UnifiedCamera(**FRAME, fx=200, fy=200, xi=1.0),
    FisheyeCamera(**FRAME, focal_px=150), FisheyeCamera(**FRAME, focal_px=150, looks="up"),
    OCamCamera(**FRAME, polynomial=MIRROR_POLYNOMIAL)])  # fmt: skip
def test_azimuth_is_counter_clockwise_from_image_right(camera):
    level = 0.5
    ring = camera.circle
    for azimuth in np.deg2rad([0, 90, 200]):
        u, v = camera.unwrap(azimuth, level)
        assert np.isclose(np.exp(1j * np.arctan2(ring.cy - v, u - ring.cx)), np.exp(1j * azimuth))


# ------------------------------------------------------------------------------------------------------------- mirrors
@given(st.floats(5, 60), st.floats(5, 90), st.floats(0.01, 0.999), st.floats(0, 2 * np.pi))
def test_rays_reflect_at_the_parabolic_mirror(h, rim, share, azimuth):
    """A ray parallel to the axis meets the mirror at its pixel's place and leaves as the direction says."""
    mirror = ParabolicMirror(h_mm=h, rim_mm=rim)
    aside = np.array([np.cos(azimuth), np.sin(azimuth)])
    direction = mirror.directions(mirror.center + share * mirror.circle.radius * aside * [1, -1])
    r = share * np.sqrt(2 * h * rim)
    Q = np.array([*(r * aside), r**2 / (2 * h) - h / 2])  # as seen from the focus
    normal = np.array([Q[0] / h, Q[1] / h, -1]) / np.hypot(r / h, 1)
    incoming = np.array([0, 0, 1.0])
    assert np.allclose(incoming - 2 * (incoming @ normal) * normal, direction, atol=1e-9)
    assert np.allclose(np.cross(Q, direction), 0, atol=1e-7 * max(1, r))  # as if it came from the focus


def test_presets_look_where_they_are_said_to():
    assert np.isclose(np.rad2deg(THESIS_HALF.highest_rad), 17.5, atol=0.5)
    assert np.isclose(np.rad2deg(THESIS_WHOLE.highest_rad), 49.7, atol=0.5)
    wide = EIZOH_WIDE_70
    assert (wide.width, wide.height) == (1280, 960)
    assert (wide.circle.cx, wide.circle.cy, wide.circle.radius) == (639.5, 479.5, 480)
    assert np.isclose(np.rad2deg(wide.highest_rad), 60, atol=0.2)
    assert np.isclose(wide.c_mm + wide.b_mm, 165, atol=0.1)  # from the camera's focus to the apex
    rim_radius = wide.a_mm * np.sqrt((1 + wide.rim_mm / wide.b_mm) ** 2 - 1)
    assert np.isclose(2 * rim_radius, 70, atol=0.1)
    assert np.isnan(wide.directions(np.array([100.0, 479.5]))).all()


# -------------------------------------------------------------------------------------------------------- the unified model
DOWNWARD = np.random.default_rng(0).normal(size=(200, 3)) * [1, 1, 0.4] - [0, 0, 0.5]


def same_pixels(one, other):
    a, b = one.pixels(DOWNWARD), other.pixels(DOWNWARD)
    both = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
    assert both.sum() > 50
    assert np.allclose(a[both], b[both], atol=1e-9)


def test_with_xi_zero_the_unified_model_is_a_pinhole():
    unified = UnifiedCamera(**FRAME, fx=100, fy=100, xi=0)
    same_pixels(unified, PinholeCamera(**FRAME, focal_px=100, looks="down"))
    x, y, z = 0.3, 0.2, -0.7  # right, up, and down along the axis
    assert np.allclose(unified.pixels(np.array([x, y, z])), [330 + 100 * x / 0.7, 229 - 100 * y / 0.7])
    assert np.isnan(unified.pixels(np.array([x, y, 0.7]))).all()


def test_with_xi_one_the_unified_model_is_the_parabolic_mirror():
    mirror = ParabolicMirror(size=400)
    center, f = mirror.center, mirror.horizon_px
    same_pixels(mirror, UnifiedCamera(width=400, height=400, cx=center, cy=center, fx=f, fy=f, xi=1))


@pytest.mark.parametrize("mirror", [HyperbolicMirror(size=400, crop=0.9), HyperbolicMirror(size=400, a_mm=60, b_mm=50)])
def test_the_unified_model_holds_the_hyperbolic_mirror(mirror):
    """xi = 2 e / (1 + e^2) for a hyperbola of eccentricity e = c / b (Barreto & Araujo, 2001)."""
    b, c, center = mirror.b_mm, mirror.c_mm, mirror.center
    f = mirror.pixels_per_slope * mirror.a_mm**2 / (b**2 + c**2)
    unified = UnifiedCamera(width=400, height=400, cx=center, cy=center, fx=f, fy=f, xi=2 * b * c / (b**2 + c**2))
    same_pixels(mirror, unified)


def test_the_unified_model_projects_as_printed():
    """As omniproj: x = X / (Z + xi |X|), y = Y / (Z + xi |X|), then K; Y is down and Z into the scene below."""
    camera = UnifiedCamera(width=1600, height=1200, cx=692.9, cy=572.1, fx=425.2, fy=424.9, xi=0.98754, skew=0.7)
    X, Y, Z = 0.4, -1.1, 0.8
    depth = Z + 0.98754 * np.sqrt(X**2 + Y**2 + Z**2)
    u, v = 425.2 * X / depth + 0.7 * Y / depth + 692.9, 424.9 * Y / depth + 572.1
    assert np.allclose(camera.pixels(np.array([X, -Y, -Z])), [u, v])


DISTORTED = UnifiedCamera(
    **FRAME, fx=400, fy=390, xi=0.9, skew=1.5, k1=-0.11, k2=0.013, p1=0.002, p2=-0.001
)  # as real calibrations have it


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01))
def test_the_lens_distorts_as_opencv_s_does(k1, k2, p1, p2):
    camera = replace(DISTORTED, xi=0, skew=0, k1=k1, k2=k2, p1=p1, p2=p2)
    points = np.random.default_rng(3).uniform([-0.6, -0.6, 1], [0.6, 0.6, 1], (40, 3))
    K = np.array([[400, 0, 330], [0, 390, 229], [0, 0, 1.0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array([k1, k2, p1, p2]))[0][:, 0]
    found = camera.pixels(points * [1, -1, -1])
    shown = np.isfinite(found).all(-1)
    assert shown.sum() > 15
    assert np.allclose(found[shown], expected[shown], atol=1e-9)


def test_distortion_is_undone_to_a_billionth_of_a_pixel():
    v, u = np.mgrid[:480:7, :640:7]
    uv = np.stack([u, v], -1).astype(float)
    assert np.abs(DISTORTED.pixels(DISTORTED.directions(uv)) - uv).max() < 1e-9


def test_where_distortion_folds_the_image_there_is_no_ray():
    folded = replace(DISTORTED, k1=-0.5, k2=0.0, p1=0.0, p2=0.0)
    turn = np.sqrt(1 / 1.5)
    assert folded.circle.radius == pytest.approx(390 * turn * (1 - 0.5 * turn**2))
    beyond = np.array([330 + 1.01 * folded.circle.radius, 229])
    assert np.isnan(folded.directions(beyond)).all()


@given(cameras, st.integers(0, 2**32 - 1))
def test_a_flipped_camera_sees_flipped_pictures(camera, seed):
    uv = np.random.default_rng(seed).uniform([0, 0], [camera.width - 1, camera.height - 1], (50, 2))
    flipped = camera.flipped().directions(np.array([camera.width - 1, 0]) + uv * [-1, 1])
    mirrored = [1, -1, 1] if getattr(camera, "looks", "") == "ahead" else [-1, 1, 1]  # what is right becomes left
    assert np.allclose(flipped, camera.directions(uv) * mirrored, equal_nan=True)
    assert np.allclose(camera.flipped().flipped().directions(uv), camera.directions(uv), equal_nan=True)


# -------------------------------------------------------------------------------------------------------------- lenses
def test_a_pinhole_ahead_sees_what_a_robot_sees():
    camera = PinholeCamera(width=101, height=101, cx=50, cy=50, focal_px=50)
    ahead, left, above = camera.pixels(np.array([[1, 0, 0], [1, 0.5, 0], [1, 0, 0.5]]))
    assert np.allclose([ahead, left, above], [[50, 50], [25, 50], [50, 25]])


@pytest.mark.parametrize(("angle_deg", "radius"), [(0, 0), (45, 100), (90, 200)])
def test_an_equidistant_fisheye_is_equidistant(angle_deg, radius):
    camera = FisheyeCamera(width=501, height=501, cx=250, cy=250, focal_px=400 / np.pi, looks="up")
    direction = [np.sin(np.deg2rad(angle_deg)), 0, np.cos(np.deg2rad(angle_deg))]
    assert np.allclose(camera.pixels(np.array(direction)), [250 + radius, 250])


def test_what_lies_beyond_the_given_rim_is_not_shown():
    camera = FisheyeCamera(**FRAME, focal_px=150, rim_px=200)
    assert camera.circle.radius == 200
    assert np.isnan(camera.directions(np.array([330.0 + 201, 229]))).all()
    assert np.isnan(camera.pixels(np.array([np.sin(1.4), 0, -np.cos(1.4)]))).all()


# ----------------------------------------------------------------------------------------------------------- panoramas
def test_panoramas_put_azimuth_and_elevation_where_they_say():
    sphere = EquirectangularCamera(360, 180)
    assert np.allclose(sphere.pixels(turned(90)), [90, 89.5])
    assert np.allclose(sphere.pixels(np.array([[0, 0, 1.0], [0, 0, -1]]))[:, 1], [-0.5, 179.5])
    part = EquirectangularCamera(360, 50, lowest_deg=-30, highest_deg=20)
    assert np.allclose(part.pixels(np.array([[1, 0, 0], [0, 1, np.tan(np.deg2rad(-30))]])), [[0, 19.5], [90, 49.5]])
    assert np.isnan(part.pixels(np.array([1, 0, np.tan(np.deg2rad(21))]))).all()
    seen_from_inside = EquirectangularCamera(360, 180, start_deg=180, clockwise=True)
    assert np.allclose(seen_from_inside.pixels(turned(90)), [90, 89.5])
    assert np.allclose(seen_from_inside.pixels(turned(0)), [180, 89.5])
    cylinder = CylindricalCamera(360, 100, lowest_deg=-45, highest_deg=45)
    assert np.allclose(cylinder.pixels(np.array([1, 0, 0.5])), [0, 24.5])
    assert np.isnan(cylinder.pixels(np.array([1, 0, 1.1]))).all()


def test_a_panorama_of_a_panorama_is_itself():
    camera = CylindricalCamera(64, 4000, lowest_deg=-60, highest_deg=60)
    columns = np.random.default_rng(2).integers(0, 255, 64, dtype=np.uint8)
    wide = panorama(np.tile(columns, (1, 4000, 1)), camera, (16, 64))
    assert np.abs(wide[0].astype(int) - columns).max() <= 1


def test_what_a_camera_ahead_does_not_see_is_black():
    camera = PinholeCamera(**FRAME, focal_px=300)
    wide = panorama(np.full((1, 480, 640), 200, np.uint8), camera, (16, 360))[0]
    assert (wide[4:12, [0, 30, 330]] == 200).all()
    assert (wide[:, 60:300] == 0).all()


def test_a_panorama_has_the_mirror_view_of_a_mirror_in_its_place():
    camera = EquirectangularCamera(360, 180)
    seen = mirror_view(np.full((1, 180, 360), 90, np.uint8), camera)
    assert seen.shape == (1, 250, 250)
    assert (seen == 90).all()


def test_a_camera_without_circle_and_rays_has_no_mirror_view():
    camera = ImageCircle(360, 180, Circle(180, 90, 0))
    with pytest.raises(
        DataError, match=r"a ImageCircle has no image circle; use a descriptor whose view is 'panorama'"
    ):
        mirror_view(np.zeros((1, 180, 360), np.uint8), camera)


# ----------------------------------------------------------------------------------------------------------- bad values
@pytest.mark.parametrize(("make", "message"), [
    (lambda: ParabolicMirror(h_mm=0), "h=0"),
    (lambda: HyperbolicMirror(margin_px=-1), "margin_px=-1"),
    (lambda: UnifiedCamera(**FRAME, fx=-1, fy=1, xi=1), "fx=-1"),
    (lambda: UnifiedCamera(**FRAME, fx=1, fy=1, xi=float("nan")), "xi=nan"),
    (lambda: FisheyeCamera(**FRAME, focal_px=0), "focal_px=0"),
    (lambda: FisheyeCamera(**FRAME, focal_px=9, looks="left"), "'left'.*'down'"),
    (lambda: FisheyeCamera(**FRAME, focal_px=100, rim_px=50, inner_px=60), "60 to 50"),
    (lambda: PinholeCamera(**{**FRAME, "cx": -5}, focal_px=9), "outside"),
    (lambda: PinholeCamera(**{**FRAME, "width": 4}, focal_px=9), "4 x 480"),
    (lambda: EquirectangularCamera(360, 1), "360 x 1"),
    (lambda: EquirectangularCamera(360, 99, lowest_deg=-91), "-91 to 90"),
    (lambda: EquirectangularCamera(360, 99, lowest_deg=9, highest_deg=9), "9 to 9"),
    (lambda: UnifiedCamera(**FRAME, fx=1, fy=1, xi=1, p2=float("inf")), "p1, p2 = .*inf"),
    (lambda: CylindricalCamera(360, 100, highest_deg=90), "-45 to 90"),
    (lambda: OCamCamera(**FRAME, polynomial=()), "polynomial"),
    (lambda: OCamCamera(**FRAME, polynomial=(-100.0,), d=2, e=1), "flatten"),
])  # fmt: skip
def test_cameras_that_cannot_be_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
