"""Mirrors without a single viewpoint and the stereo pair: reflection, round trips and closed forms of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import CalibratedCamera
from omnilab.cameras import (
    ConicalMirror,
    EllipticMirror,
    HyperbolicMirror,
    PinholeCamera,
    SphericalMirror,
    StereoCamera,
    load_camera,
    save_camera,
)
from omnilab.cameras.noncentral import ConicMirror
from omnilab.errors import ConfigError
from omnilab.image import panorama

size, crop, distance = st.integers(32, 400), st.floats(0.3, 1), st.floats(15, 300)
share = st.floats(0.2, 0.75)  # of the mirror's half width that is within the rim: the camera sees at least so much


def seen(radius, b, distance):
    """Radius at which rays from `distance` below an ellipse touch it."""
    z = b * distance / (b + distance)
    return radius * np.sqrt(1 - (1 - z / b) ** 2)


spheres = st.builds(
    lambda size, crop, d, r, s: SphericalMirror(size, crop, distance_mm=d, radius_mm=r, rim_radius_mm=s * seen(r, r, d)),
    size, crop, distance, st.floats(10, 200), share,
)  # fmt: skip
ellipses = st.builds(
    lambda size, d, a, b, s: EllipticMirror(size, distance_mm=d, a_mm=a, b_mm=b, rim_radius_mm=s * seen(a, b, d)),
    size, distance, st.floats(10, 200), st.floats(10, 200), share,
)  # fmt: skip
cones = st.builds(
    lambda size, d, r, angle: ConicalMirror(size, distance_mm=d, rim_radius_mm=r, half_angle_deg=angle),
    size, distance, st.floats(5, 100), st.floats(20, 80),
)  # fmt: skip
mirrors = st.one_of(spheres, ellipses, cones)
seeds = st.integers(0, 2**32 - 1)


def pixels_of(camera, seed, count=60):
    """Pixels within the rim and the frame."""
    uv = np.random.default_rng(seed).uniform(-0.49, [camera.width - 0.51, camera.height - 0.51], (count, 2))
    away = np.hypot(*(uv - [camera.circle.cx, camera.circle.cy]).T)
    return uv[(away < 0.99 * camera.circle.radius) & (away > 1e-3)]


def surface(mirror, x, y, z):
    """What is 0 on the mirror, in millimetres, and its gradient."""
    if isinstance(mirror, ConicalMirror):
        tan = np.tan(np.deg2rad(mirror.half_angle_deg))
        return np.hypot(x, y) - z * tan, np.stack([x / np.hypot(x, y), y / np.hypot(x, y), np.full_like(x, -tan)], -1)
    a, b = (mirror.radius_mm,) * 2 if isinstance(mirror, SphericalMirror) else (mirror.a_mm, mirror.b_mm)
    value = x**2 / a**2 + y**2 / a**2 + (z - b) ** 2 / b**2 - 1  # around (0, 0, b)
    return value, np.stack([x / a**2, y / a**2, (z - b) / b**2], -1)


@given(mirrors, seeds)
def test_rays_reflect_at_mirrors_without_a_viewpoint(mirror, seed):
    uv = pixels_of(mirror, seed)
    Q, d = mirror.origins(uv) * 1000, mirror.directions(uv)
    value, normal = surface(mirror, *Q.T)
    assert np.abs(value).max() < 1e-9 * max(1, mirror.rim_radius_mm)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    incoming = Q + np.array([0, 0, mirror.distance_mm])
    # the picture is a perspective one: pixels are proportional to the slopes of the camera's rays
    slopes = incoming[:, :2] / incoming[:, 2:]
    offset = (uv - [mirror.circle.cx, mirror.circle.cy]) * [1, -1]
    assert np.allclose(slopes * mirror.pixels_per_slope, offset, atol=1e-7)
    incoming /= np.linalg.norm(incoming, axis=-1, keepdims=True)
    facing = (incoming * normal).sum(-1, keepdims=True)
    assert (np.abs(facing) > 1e-6).all()
    assert np.allclose(incoming - 2 * facing * normal, d, atol=1e-7)
    assert ((d * normal).sum(-1) * facing[:, 0] < 0).all()  # it leaves on the side that the camera is on


@given(mirrors, seeds, st.floats(-3, 4))
def test_pixels_of_mirrors_without_a_viewpoint_are_found_again(mirror, seed, exponent):
    uv = pixels_of(mirror, seed)
    o, d = mirror.origins(uv), mirror.directions(uv)
    assert np.allclose(mirror.pixels(2.5 * d), uv, atol=1e-6)
    assert np.allclose(mirror.project(o + 10**exponent * d), uv, atol=1e-6)


@given(mirrors, seeds)
def test_points_have_the_pixel_whose_ray_meets_them_or_none(mirror, seed):
    points = np.random.default_rng(seed).normal(size=(60, 3)) * [0.3, 0.3, 0.5]
    uv = mirror.project(points)
    shown = np.isfinite(uv).all(-1)
    assert np.array_equal(shown, np.isfinite(uv).any(-1))
    o, d = mirror.origins(uv[shown]), mirror.directions(uv[shown])
    away = points[shown] - o
    assert np.linalg.norm(np.cross(away, d), axis=-1).max(initial=0) < 1e-7
    assert ((away * d).sum(-1) > 0).all()


@given(mirrors)
def test_mirrors_without_a_viewpoint_unwrap_within_their_elevations(mirror):
    assert isinstance(mirror, CalibratedCamera)
    lowest, highest = mirror.elevations_rad
    uv = mirror.unwrap(np.zeros(9), np.linspace(0.01, 0.99, 9))
    z = mirror.directions(uv)[:, 2]
    assert np.all(np.diff(z) > 0)
    assert np.all((z >= np.sin(lowest)) & (z <= np.sin(highest)))
    assert np.allclose(mirror.directions(uv)[:, 1], 0, atol=1e-9)


@given(distance, st.floats(20, 80), st.floats(0.01, 0.99))
def test_rays_of_a_cone_seem_to_come_from_the_camera_mirrored_at_it(d, half_angle, share):
    """In the plane of a pixel the cone is a straight line, so that the camera's mirror image is where rays come from."""
    mirror = ConicalMirror(distance_mm=d, half_angle_deg=half_angle)
    uv = np.array([mirror.circle.cx + share * mirror.circle.radius, mirror.circle.cy])
    angle = np.arctan(share * mirror.circle.radius / mirror.pixels_per_slope)
    elevation = np.pi / 2 - 2 * np.deg2rad(half_angle) + angle
    assert np.allclose(mirror.directions(uv), [np.cos(elevation), 0, np.sin(elevation)])
    double = 2 * np.deg2rad(half_angle)
    image = -d * np.array([np.sin(double), 0, np.cos(double)]) / 1000
    assert np.allclose(np.cross(mirror.origins(uv) - image, mirror.directions(uv)), 0, atol=1e-9)


def test_an_ellipse_with_equal_axes_is_a_ball():
    ball, ellipse = SphericalMirror(radius_mm=50), EllipticMirror(a_mm=50, b_mm=50)
    uv = pixels_of(ball, 1)
    assert np.allclose(ball.origins(uv), ellipse.origins(uv))
    assert np.allclose(ball.directions(uv), ellipse.directions(uv))


@dataclass(frozen=True)
class Hyperbola(ConicMirror):
    """z^2 / b^2 - r^2 / a^2 = 1, its apex moved to 0."""

    a_mm: float = 40.0
    b_mm: float = 160.0

    @property
    def _curvature_mm(self):
        return self.a_mm**2 / self.b_mm

    @property
    def _shape(self):
        return -((self.a_mm / self.b_mm) ** 2)


@pytest.mark.parametrize(("a", "b"), [(40.0, 160.0), (60.0, 50.0)])
def test_with_the_camera_in_its_focus_a_hyperbola_has_one_viewpoint(a, b):
    """What all conics share, against the closed form of the central mirror."""
    central = HyperbolicMirror(a_mm=a, b_mm=b, crop=1.0)
    rim = a * np.sqrt((b + central.rim_mm) ** 2 / b**2 - 1)
    mirror = Hyperbola(distance_mm=b + central.c_mm, rim_radius_mm=rim, a_mm=a, b_mm=b)
    uv = pixels_of(mirror, 2)
    assert np.allclose(mirror.directions(uv), central.directions(uv), atol=1e-9)
    from_focus = mirror.origins(uv) - [0, 0, (central.c_mm - b) / 1000]
    assert np.allclose(np.cross(from_focus, mirror.directions(uv)), 0, atol=1e-12)
    points = np.random.default_rng(3).normal(size=(99, 3)) - [0, 0, 0.5]
    expected = central.pixels(points - [0, 0, (central.c_mm - b) / 1000])
    expected[np.hypot(*(expected - central.center).T) > 125] = np.nan
    assert np.allclose(mirror.project(points), expected, equal_nan=True, atol=1e-6)


def test_a_cone_shows_nothing_below_its_lowest_elevation():
    lowest, highest = np.rad2deg(ConicalMirror().elevations_rad)
    assert lowest == pytest.approx(-20)
    assert highest == pytest.approx(16, abs=0.5)
    assert np.isnan(ConicalMirror().pixels(np.array([1, 0, np.tan(np.deg2rad(-20.1))]))).all()
    assert np.isfinite(ConicalMirror().pixels(np.array([1, 0, np.tan(np.deg2rad(-19.9))]))).all()


def test_the_defaults_reach_as_far_as_they_say():
    assert np.rad2deg(SphericalMirror().highest_rad) == pytest.approx(48, abs=0.5)
    assert np.rad2deg(EllipticMirror().highest_rad) == pytest.approx(58, abs=0.5)


def test_what_is_behind_or_inside_a_mirror_has_no_pixel():
    mirror = SphericalMirror()
    behind = np.array([[0, 0, 0.02], [0, 0, 1], [0.02, 0, 0.03], [0.03, 0, 1.0]])
    assert np.isnan(mirror.project(behind)).all()
    assert np.allclose(mirror.project(np.array([0, 0, -1.0])), [124.5, 124.5])


def test_files_and_panoramas_take_mirrors_without_a_viewpoint(tmp_path):
    for camera in (ConicalMirror(), EllipticMirror(b_mm=60), SphericalMirror(size=99),
                   StereoCamera(width=640, height=240, focal_px=300, baseline_m=0.12)):  # fmt: skip
        save_camera(camera, tmp_path / "camera.json")
        assert load_camera(tmp_path / "camera.json") == camera
    grey = np.full((1, 250, 250), 77, np.uint8)
    assert (panorama(grey, ConicalMirror(), (16, 64)) == 77).all()


# -------------------------------------------------------------------------------------------------------------- stereo
STEREO = StereoCamera(width=640, height=240, focal_px=300, baseline_m=0.12)


@given(st.floats(0.3, 50), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_disparity_is_focal_length_times_baseline_over_depth(depth, y, z):
    point = depth * np.array([1, y, z])
    left, right = STEREO.project(point), STEREO.project_right(point)
    if np.isfinite(left).all() and np.isfinite(right).all():
        assert left[1] == pytest.approx(right[1])
        assert left[0] - (right[0] - 320) == pytest.approx(300 * 0.12 / depth)


@given(seeds, st.floats(-1, 3))
def test_both_halves_see_the_points_of_their_rays(seed, exponent):
    uv = np.random.default_rng(seed).uniform([-0.49, -0.49], [639.49, 239.49], (60, 2))
    points = STEREO.origins(uv) + 10**exponent * STEREO.directions(uv)
    left = uv[:, 0] < 319.5
    assert np.allclose(STEREO.project(points[left]), uv[left], atol=1e-6)
    assert np.allclose(STEREO.project_right(points[~left]), uv[~left], atol=1e-6)
    assert (np.sign(STEREO.origins(uv)[:, 1]) == np.where(left, 1, -1)).all()
    assert np.allclose(STEREO.pixels(STEREO.directions(uv[left])), uv[left])


def test_a_stereo_camera_is_two_pinholes():
    left = PinholeCamera(width=320, height=240, cx=159.5, cy=119.5, focal_px=300)
    assert STEREO.left == STEREO.right == left
    assert STEREO.elevations_rad == left.elevations_rad
    assert STEREO.circle == left.circle


# ---------------------------------------------------------------------------------------------------------- bad values
@pytest.mark.parametrize(("make", "message"), [
    (lambda: SphericalMirror(radius_mm=0), "radius_mm=0"),
    (lambda: SphericalMirror(radius_mm=30), "up to a radius of 29.2 mm.* rim of 35 mm is hidden"),
    (lambda: SphericalMirror(distance_mm=10), "from 10 mm the camera sees this mirror up to a radius of 24.0"),
    (lambda: SphericalMirror(distance_mm=-10), "distance_mm=-10"),
    (lambda: SphericalMirror(rim_radius_mm=float("nan")), "rim_radius_mm=nan"),
    (lambda: EllipticMirror(b_mm=-1), "b=-1"),
    (lambda: ConicalMirror(half_angle_deg=90), "half_angle_deg=90"),
    (lambda: ConicalMirror(crop=1.5), "crop=1.5"),
    (lambda: StereoCamera(width=641, height=240, focal_px=300, baseline_m=0.1), "width=641"),
    (lambda: StereoCamera(width=640, height=240, focal_px=300, baseline_m=0), "baseline_m=0"),
    (lambda: StereoCamera(width=640, height=240, focal_px=0, baseline_m=1), "focal_px=0"),
])  # fmt: skip
def test_mirrors_that_cannot_be_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
