"""Altimeters on pictures whose motion is known exactly."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from omnilab.api import Circle
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror, ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import wrap_angle
from omnilab.testing import check_altimeter
from omnilab_appearance import FeatureAltitude, FloorAndWalls, RadonCompression
from omnilab_appearance.altimeters.elevations import rows_of
from omnilab_appearance.altimeters.feature_altitude import radial_displacement
from omnilab_appearance.altimeters.radon_compression import compressions, heights_of
from omnilab_appearance.common.local_features import Detector

CAMERA = HyperbolicMirror(200, crop=0.5)
ALL = [RadonCompression(120, 60), FeatureAltitude(), FeatureAltitude(Detector.sift), FloorAndWalls()]


@pytest.mark.parametrize("altimeter", ALL, ids=repr)
def test_the_contract(altimeter):
    check_altimeter(altimeter)


@cache
def speckles():
    rng = np.random.default_rng(0)
    return [gaussian_filter(rng.standard_normal((512, 512)), 3, mode="wrap") for _ in range(2)]


def seen_from(height_m, heading_rad, room_m=3.0, camera=CAMERA):
    """A round room with a speckled floor and wall, by intersecting the camera's rays with them."""
    floor, wall = speckles()
    v, u = np.mgrid[: camera.height, : camera.width]
    d = camera.directions(np.stack([u, v], -1).astype(float))
    azimuth = np.arctan2(d[..., 1], d[..., 0]) + heading_rad
    tangent = d[..., 2] / np.hypot(d[..., 0], d[..., 1])
    with np.errstate(divide="ignore"):
        range_m = np.where(tangent < 0, np.minimum(-height_m / tangent, room_m), room_m)
    at = [255 + 60 * range_m * np.cos(azimuth), 255 + 60 * range_m * np.sin(azimuth)]
    on_floor = map_coordinates(floor, at, order=1, mode="wrap")
    at = [azimuth * 512 / (2 * np.pi), 60 * (height_m + range_m * tangent)]
    on_wall = map_coordinates(wall, at, order=1, mode="grid-wrap")
    picture = np.where(range_m < room_m, on_floor, on_wall)
    return np.clip(127 + 40 * picture / floor.std(), 0, 255).astype(np.uint8)


def test_floor_and_walls_tells_rise_and_rotation_in_round_rooms():
    """Of 150 such rooms one had its rise heights wrong by more than 5 % of the larger height, and none its rotation."""
    rng, right = np.random.default_rng(0), 0
    for _ in range(24):
        reference_m, test_m, heading_rad, room_m = rng.uniform([0.3, 0.3, -3, 2], [2, 2.5, 3, 6])
        reference, test = seen_from(reference_m, 0.4, room_m), seen_from(test_m, 0.4 + heading_rad, room_m)
        heights = FloorAndWalls(scale_m=reference_m).relative(reference[None], test[None], CAMERA)
        right += abs(heights.value[0] - (test_m - reference_m)) < 0.05 * max(reference_m, test_m)
        assert abs(wrap_angle(heights.rotation_rad[0] - heading_rad)) < np.deg2rad(2)
        assert heights.confidence[0] > 0.1
    assert right >= 23
    assert heights.unit == "m"
    assert heights.curves["least_distance"].shape == (1, 117)


def test_floor_and_walls_is_the_same_for_any_camera_that_sees_the_floor():
    sphere = EquirectangularCamera(500, 250)
    for camera in (HyperbolicMirror(250, crop=1.0), sphere):
        images = np.stack([seen_from(1.0, 0.0, camera=camera), seen_from(1.3, 1.0, camera=camera)])
        heights = FloorAndWalls().relative(images[:1], images[1:], camera)
        assert heights.unit == "reference heights"
        assert heights.value[0] == pytest.approx(0.3, abs=0.03)


def test_rows_of_a_panorama_have_no_seam_and_count_by_their_length_on_the_sphere():
    picture = np.random.default_rng(6).integers(0, 256, (64, 128), np.uint8)
    here, there = (rows_of(EquirectangularCamera(128, 64, start), 30, -75.0, 15.0, 0.5) for start in (0.0, 180.0))
    assert np.allclose(here.sample(picture), there.sample(np.roll(picture, 64, axis=1)), atol=1e-3)
    assert here.weight == pytest.approx(np.cos(np.deg2rad(-75 + 3 * (np.arange(30) + 0.5))), abs=1e-3)


def test_an_uncalibrated_circle_has_its_horizon_where_it_is_said_to_be():
    ring = ImageCircle(200, 200, Circle(100, 100, 90, 0))
    rows = rows_of(ring, 90, -90.0, 90.0, 0.5)
    radius = np.hypot(*(rows.uv[:, 0] - 100).T)
    assert np.allclose(np.diff(radius), 1, atol=1e-4)  # 90 pixels over 90 rows
    assert radius[44:46].mean() == pytest.approx(45, abs=1e-3)  # elevation 0
    sky = rows_of(ImageCircle(200, 200, Circle(100, 100, 90, 0), sky_inside=True), 90, -90.0, 90.0, 0.5)
    assert np.allclose(np.hypot(*(sky.uv[:, 0] - 100).T), 90 - radius, atol=1e-4)
    blind = rows_of(ImageCircle(200, 200, Circle(100, 100, 90, 30)), 90, -90.0, 0.0, 0.5)
    assert blind.valid.all(), "the ring begins at its inner edge"


def by_interpolation(still, squeezed, count):
    """Equations 5.5 to 5.9, column by column."""
    n, distances = len(still), []
    for a in range(count):
        rows = n - 2 * a
        at = np.arange(1, rows + 1) * n / rows
        compressed = np.stack([np.interp(at, np.arange(1, n + 1), column) for column in squeezed.T], -1)
        middle = still[a : n - a]
        apart = middle / middle.max(axis=1, keepdims=True) - compressed / compressed.max(axis=1, keepdims=True)
        distances.append(np.abs(apart).mean())
    return np.array(distances)


def test_compressions_are_those_of_the_printed_equations():
    first, second, third = np.random.default_rng(1).uniform(0.1, 1, (3, 41, 24)).astype(np.float32)
    falling, rising = compressions(first[None], np.stack([second, third]), 15)
    for i, test in enumerate((second, third)):
        assert np.allclose(falling[i], by_interpolation(first, test, 15), rtol=1e-5)
        assert np.allclose(rising[i], by_interpolation(test, first, 15), rtol=1e-5)


def test_the_case_with_the_smaller_minimum_tells_up_from_down():
    curve, flat = np.array([5, 4, 1, 3.0]), np.full(4, 3.0)
    heights = heights_of(np.stack([flat, curve]), np.stack([curve, flat]), np.zeros(2))
    assert heights.value.tolist() == [2, -2]
    assert heights.confidence == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("altimeter", ALL, ids=repr)
def test_all_tell_up_from_down_and_by_how_far(altimeter):
    images = np.stack([seen_from(h, 0.3 * i) for i, h in enumerate((1.0, 0.7, 0.85, 1.15, 1.3))])
    heights = altimeter.relative(images[:1], images, CAMERA)
    assert heights.value[0] == pytest.approx(0, abs=1e-3)
    assert (np.sign(heights.value[1:]) == [-1, -1, 1, 1]).all()
    assert abs(heights.value[1]) > abs(heights.value[2])
    assert heights.value[4] > heights.value[3]
    assert np.abs(wrap_angle(heights.rotation_rad - 0.3 * np.arange(5))).max() < np.deg2rad(3)


def test_moves_count_towards_the_centre_and_those_that_turn_otherwise_do_not():
    angle = np.deg2rad([0, 50, 100, 200, 300])
    reference = 100 * np.stack([np.cos(angle), np.sin(angle)], -1)
    turned = np.deg2rad(-20)  # the camera turns to the left by 20 degrees, what it sees to the right
    test = 0.9 * reference @ np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
    test[-1] *= -1  # a wrong match
    value, share, rotation = radial_displacement(test, reference, np.deg2rad(2))
    assert (value, share) == (pytest.approx(10), pytest.approx(0.8))
    assert rotation == pytest.approx(np.deg2rad(20))


def test_without_matches_there_is_no_height():
    black = np.zeros((2, 200, 200), np.uint8)
    heights = FeatureAltitude().relative(black[:1], black, CAMERA)
    assert np.isnan(heights.value).all()
    assert (heights.confidence == 0).all()


@pytest.mark.parametrize("altimeter", ALL, ids=repr)
def test_images_that_are_no_pairs_are_refused(altimeter):
    one, small = np.zeros((1, 200, 200), np.uint8), np.zeros((1, 150, 200), np.uint8)
    with pytest.raises(DataError, match="the reference is 200 x 200 pixels, the test 200 x 150"):
        altimeter.relative(one, small, CAMERA)
    with pytest.raises(DataError, match="2 references were given for 3 tests"):
        altimeter.relative(np.repeat(one, 2, 0), np.repeat(one, 3, 0), CAMERA)
    with pytest.raises(DataError, match="are not grey"):
        altimeter.relative(one[..., None], one[..., None], CAMERA)


def test_a_camera_that_sees_no_floor_is_refused():
    camera = EquirectangularCamera(200, 100, lowest_deg=5, highest_deg=40)
    one = np.zeros((1, 100, 200), np.uint8)
    with pytest.raises(DataError, match=r"shows \d+ whole rows between -80 and 15 degrees"):
        FloorAndWalls().relative(one, one, camera)


@pytest.mark.parametrize(
    "make",
    [
        lambda: FloorAndWalls(scale_m=0.0), lambda: FloorAndWalls(lowest_deg=5.0), lambda: FloorAndWalls(highest_deg=95),
        lambda: FloorAndWalls(rows=3), lambda: FloorAndWalls(frequencies=33), lambda: FloorAndWalls(horizon=0.0),
        lambda: RadonCompression(most=0.5), lambda: RadonCompression(offsets=2), lambda: FeatureAltitude(ratio=0.0),
        lambda: FeatureAltitude(tolerance_deg=0.0), lambda: FeatureAltitude(features=0),
    ],
)  # fmt: skip
def test_settings_that_tell_nothing_are_refused(make):
    with pytest.raises(ConfigError):
        make()
