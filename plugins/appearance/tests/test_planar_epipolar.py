"""Relative poses of synthetic matches, and of pictures of a room whose rays are intersected one by one."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.stats import kstest

from omnilab.api import Circle, Frames, ImageFeatures, Unusable
from omnilab.cameras import (
    CylindricalCamera,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    ImageCircle,
    ParabolicMirror,
    UnifiedCamera,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import wrap_angle
from omnilab.testing import check_odometry
from omnilab_appearance import PlanarEpipolar
from omnilab_appearance.common.feature_surfaces import FeatureSurface, surface_features
from omnilab_appearance.common.ground_scale import ground_step
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.relative_pose import Solver, decompose, essential, pose_of, relative_pose, sampson_errors
from omnilab_appearance.common.spherical_features import match_features, spherical_features
from omnilab_appearance.odometries.planar_epipolar import Length

MIRROR = HyperbolicMirror(480, crop=0.5)
HORIZONTAL = st.floats(-np.pi, np.pi)


def turned(points, phi):
    """Points (M, 3) of the second camera's frame in axes of the first."""
    c, s = np.cos(phi), np.sin(phi)
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def matches(rng, count, phi, beta, length=0.3, noise=0.0, wrong=0, half_angle_deg=180.0):
    """Directions of points within a cone about x, 1 to 4 units off; of the last `wrong` the second are of other points."""
    points = cone(rng, count, half_angle_deg) * rng.uniform(1, 4, (count, 1))
    seen = turned(points - length * np.array([np.cos(beta), np.sin(beta), 0]), -phi)
    seen[count - wrong :] = cone(rng, wrong, half_angle_deg)
    return [noisy(d, noise, rng) for d in (points, seen)]


def cone(rng, count, half_angle_deg):
    """Directions (count, 3) evenly spread."""
    x, around = rng.uniform(np.cos(np.deg2rad(half_angle_deg)), 1, count), rng.uniform(-np.pi, np.pi, count)
    return np.column_stack([x, *(np.sqrt(1 - x**2) * [np.cos(around), np.sin(around)])])


def noisy(points, noise, rng):
    directions = points / np.linalg.norm(points, axis=1, keepdims=True) + noise * rng.standard_normal(points.shape)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.slow
@given(HORIZONTAL, HORIZONTAL, st.floats(0.05, 0.9), st.sampled_from(Solver), st.integers(0, 9))
@settings(max_examples=80, deadline=None)
def test_exact_matches_give_the_exact_motion(phi, beta, length, solver, seed):
    rng = np.random.default_rng(seed)
    p, q = matches(rng, 60, phi, beta, length)
    motion = pose_of(p, q, rng, solver)
    assert motion.failed == ""
    assert abs(wrap_angle(motion.phi - phi)) < 1e-6
    assert abs(wrap_angle(motion.beta - beta)) < 1e-5
    assert motion.agree.all()


@given(HORIZONTAL, HORIZONTAL)
@settings(max_examples=30)
def test_the_essential_matrix_is_that_of_the_motion(phi, beta):
    rng = np.random.default_rng(0)
    p, q = matches(rng, 20, phi, beta)
    t = np.array([np.cos(beta), np.sin(beta), 0])
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    np.testing.assert_allclose(essential(phi, beta), cross @ turned(np.eye(3), phi).T, atol=1e-12)
    assert sampson_errors(p, q, phi, beta).max() < 1e-9
    for E in (essential(phi, beta), -essential(phi, beta)):
        np.testing.assert_allclose(wrap_angle(np.subtract(decompose(E, p, q), (phi, beta))), 0, atol=1e-9)


@pytest.mark.parametrize("solver", Solver)
def test_wrong_matches_are_left_out(solver):
    rng = np.random.default_rng(2)
    for _ in range(8):
        phi, beta = rng.uniform(-3, 3, 2)
        p, q = matches(rng, 300, phi, beta, noise=1e-3, wrong=120)
        motion = pose_of(p, q, rng, solver)
        assert abs(wrap_angle(motion.phi - phi)) < 0.002
        assert abs(wrap_angle(motion.beta - beta)) < 0.01
        assert motion.agree[:180].mean() > 0.98
        assert motion.agree[180:].mean() < 0.1


@pytest.mark.parametrize(("count", "noise"), [(30, 1e-3), (150, 3e-4), (150, 2e-3)])
def test_errors_are_as_the_covariance_says(count, noise):
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(300):
        phi, beta = rng.uniform(-3, 3, 2)
        motion = pose_of(*matches(rng, count, phi, beta, noise=noise), rng, tolerance_deg=1)
        error = wrap_angle(np.array([motion.phi - phi, motion.beta - beta]))
        squares.append(error @ np.linalg.solve(motion.covariance, error))
    assert np.mean(squares) == pytest.approx(2, rel=0.25)
    if count > 100:  # with few matches the noise itself is known too badly for the square to be chi-square
        assert kstest(squares, "chi2", args=(2,)).pvalue > 1e-3


@pytest.mark.parametrize("wrong", [60, 120])
@pytest.mark.parametrize("half_angle_deg", [45, 180])
def test_errors_are_as_the_covariance_says_among_wrong_matches(half_angle_deg, wrong):
    """In a cone a wrong match is more often near its epipolar line by chance; one alone could outweigh all good ones."""
    rng = np.random.default_rng(3)
    squares = []
    for _ in range(300):
        phi, beta = rng.uniform(-3, 3, 2)
        motion = pose_of(*matches(rng, 300, phi, beta, noise=1e-3, wrong=wrong, half_angle_deg=half_angle_deg), rng)
        error = wrap_angle(np.array([motion.phi - phi, motion.beta - beta]))
        squares.append(error @ np.linalg.solve(motion.covariance, error))
    assert np.mean(squares) == pytest.approx(2, rel=0.25)
    assert kstest(squares, "chi2", args=(2,)).pvalue > 1e-3


def test_a_match_on_the_other_side_of_the_direction_does_not_agree():
    """It lies in the plane of its match and the direction, but no point is seen above and below."""
    p, q = matches(np.random.default_rng(0), 100, 0.2, 0.5)
    c, s = np.cos(0.5 - 0.2), np.sin(0.5 - 0.2)
    mirrored = q * [1, 1, -1] - 2 * np.outer(q @ [s, -c, 0], [s, -c, 0])  # half a turn about the direction
    q[60:] = mirrored[60:]
    motion = pose_of(p, q, np.random.default_rng(0))
    assert sampson_errors(p, q, 0.2, 0.5).max() < 1e-9
    assert motion.agree.tolist() == [True] * 60 + [False] * 40
    assert abs(motion.phi - 0.2) < 1e-6
    assert abs(motion.beta - 0.5) < 1e-5


@given(HORIZONTAL, st.sampled_from([0.0, 1e-3]))
@settings(max_examples=20, deadline=None)
def test_a_rotation_alone_gives_no_direction(phi, noise):
    rng = np.random.default_rng(4)
    motion = pose_of(*matches(rng, 200, phi, 0.0, length=0.0, noise=noise), rng)
    assert "no parallax" in motion.failed
    assert abs(wrap_angle(motion.phi - phi)) < 5 * np.sqrt(motion.covariance[0, 0])
    assert np.isnan(motion.beta)
    assert np.isinf(motion.covariance[1, 1])


def test_too_few_matches_and_matches_that_do_not_agree_are_said():
    rng = np.random.default_rng(0)
    assert pose_of(*matches(rng, 5, 0.1, 0.2), rng).failed == "5 matches"
    assert pose_of(np.zeros((0, 3)), np.zeros((0, 3)), rng).failed == "0 matches"
    motion = pose_of(*matches(rng, 40, 0.1, 0.2, wrong=40), rng, tolerance_deg=0.05)
    assert "of 40 matches agree" in motion.failed
    assert np.isnan(motion.phi)


def test_points_at_the_horizon_give_no_motion():
    azimuth = np.linspace(0, 6, 50)
    p = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], -1)
    assert pose_of(p, turned(p, -0.1), np.random.default_rng(0)).failed


def test_the_same_seed_gives_the_same_bits():
    p, q = matches(np.random.default_rng(5), 100, 0.3, 1.0, noise=2e-3, wrong=60)
    first, again = (pose_of(p, q, np.random.default_rng(7)) for _ in range(2))
    assert first.phi == again.phi
    assert first.beta == again.beta
    np.testing.assert_array_equal(first.covariance, again.covariance)


@given(HORIZONTAL, HORIZONTAL, st.floats(0.03, 0.5))
@settings(max_examples=30)
def test_the_floor_is_what_lies_lowest(phi, beta, length):
    rng = np.random.default_rng(3)
    heights = np.repeat([-1.0, -0.6], [20, 40])  # most points lie on tables
    points = np.column_stack([rng.uniform(-2, 2, (60, 2)), heights])
    seen = turned(points - length * np.array([np.cos(beta), np.sin(beta), 0]), -phi)
    motion = ground_step(noisy(points, 0, rng), noisy(seen, 0, rng), phi, beta, 1e-4)
    assert motion.length == pytest.approx(length, rel=1e-6)
    assert motion.points <= 20


# ------------------------------------------------------------------------------------------------ pictures of a room
@cache
def speckles():
    rng = np.random.default_rng(0)
    layers = [gaussian_filter(rng.standard_normal((1024, 1024)), s, mode="wrap") for s in (3, 6, 12)]
    return sum(layer / layer.std() for layer in layers)


def seen_from(x, y, heading, camera, radius=3.0, height=1.0):
    """A round room with speckled floor, wall and ceiling, by intersecting the camera's rays with them."""
    v, u = np.mgrid[: camera.height, : camera.width]
    d = turned(camera.directions(np.stack([u, v], -1).astype(float)), heading)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = (d[..., :2] ** 2).sum(-1)
        middle = -(d[..., 0] * x + d[..., 1] * y)
        wall = (middle + np.sqrt(middle**2 - flat * (x**2 + y**2 - radius**2))) / flat
        level = np.where(d[..., 2] < 0, -height / d[..., 2], 2 * height / d[..., 2])
        reach = np.minimum(wall, level)
        px, py, pz = x + reach * d[..., 0], y + reach * d[..., 1], reach * d[..., 2]
        on_wall = [np.arctan2(py, px) * 1024 / (2 * np.pi), 100 * pz]
        where = np.where(wall < level, on_wall, [512 + 100 * px, 300 * (pz > 0) + 100 * py])
    grey = map_coordinates(speckles(), np.nan_to_num(where), order=1, mode="grid-wrap")
    return np.where(np.isfinite(reach), np.clip(127 + 30 * grey, 0, 255), 0).astype(np.uint8)


def frames(images, camera):
    n = len(images)
    return Frames(np.stack(images), [str(k) for k in range(n)], np.arange(n), camera, np.arange(n))


FRAME = {"width": 480, "height": 480, "cx": 239.5, "cy": 239.5, "rim_px": 239.0}
CAMERAS = {
    "hyperbolic": MIRROR,
    "parabolic": ParabolicMirror(480),
    "unified": UnifiedCamera(**FRAME, fx=160.0, fy=160.0, xi=0.9),
    "equirectangular": EquirectangularCamera(720, 360),
    "cylindrical": CylindricalCamera(720, 240),
    "fisheye looking up": FisheyeCamera(**FRAME, focal_px=150.0, looks="up"),
}


@pytest.mark.parametrize(("name", "surface"), [
    *((name, FeatureSurface.panorama) for name in CAMERAS),
    *((name, surface) for name in ("hyperbolic", "equirectangular") for surface in (FeatureSurface.image, FeatureSurface.tiles)),
])  # fmt: skip
def test_every_camera_model_estimates_the_motion(name, surface):
    camera = CAMERAS[name]
    at = [(0.3, -0.2, 0.5), (0.3 + 0.2 * np.cos(1.7), -0.2 + 0.2 * np.sin(1.7), 0.8)]
    features = PlanarEpipolar(surface=surface).extract(frames([seen_from(*pose, camera) for pose in at], camera))
    for each in features:  # where the panorama has them, too
        pixels = camera.unwrap(*np.moveaxis(each.azimuth_level.astype(float), -1, 0))
        np.testing.assert_allclose(camera.directions(pixels), each.directions, atol=1e-4)
    motion = relative_pose(*features, np.random.default_rng(0))
    assert motion.failed == ""
    assert abs(wrap_angle(motion.phi - 0.3)) < np.deg2rad(0.3)
    assert abs(wrap_angle(motion.beta - 1.2)) < np.deg2rad(3)


@pytest.fixture(scope="module")
def pair():
    poses = [(0.3, -0.2, 0.5), (0.3 + 0.2 * np.cos(1.7), -0.2 + 0.2 * np.sin(1.7), 0.8), (0.25, 0.2, 0.7)]
    return frames([seen_from(*pose, MIRROR) for pose in poses], MIRROR)


@pytest.mark.parametrize("odometry", [PlanarEpipolar(), PlanarEpipolar(length=Length.poc)], ids=["floor", "poc"])
def test_the_contract(odometry, pair):
    check_odometry(odometry, pair)


def test_lengths_by_the_floor_are_heights_of_the_camera_or_metres(pair):
    odometry, metric = PlanarEpipolar(), PlanarEpipolar(height_m=0.8)
    a, b, _ = odometry.extract(pair)
    motion, scaled = (o.estimate(a, b, np.random.default_rng(0)) for o in (odometry, metric))
    assert (motion.unit, scaled.unit) == ("camera heights", "m")
    truth = np.array([0.2 * np.cos(1.2), 0.2 * np.sin(1.2), 0.3])
    assert np.abs(motion.vector - truth)[:2].max() < 0.01
    assert (np.abs(motion.vector - truth) < 5 * np.sqrt(np.diag(motion.covariance))).all()
    np.testing.assert_allclose(scaled.vector, motion.vector * [0.8, 0.8, 1])
    np.testing.assert_allclose(scaled.covariance, motion.covariance * np.outer([0.8, 0.8, 1], [0.8, 0.8, 1]))
    assert motion.matches.shape == (len(motion.agree), 2, 2)


def test_features_stay_small_and_pickle(pair):
    features = PlanarEpipolar().extract(pair.at(0))[0]
    assert sum(part.nbytes for part in (features.directions, features.azimuth_level, features.vectors)) < 77_000
    again = pickle.loads(pickle.dumps(features))
    np.testing.assert_array_equal(again.directions, features.directions)


def test_features_across_the_seam_are_found():
    camera = EquirectangularCamera(512, 256)
    features = spherical_features(frames([seen_from(0, 0, 0, camera)], camera), Detector.sift, 400, 12)[0]
    azimuth = features.azimuth_level[:, 0]
    assert ((azimuth < 0.1) | (azimuth > 2 * np.pi - 0.1)).sum() >= 5
    np.testing.assert_allclose(
        np.mod(np.arctan2(features.directions[:, 1], features.directions[:, 0]), 2 * np.pi), azimuth, atol=1e-5
    )


def test_sharper_panoramas_show_more_of_a_sharp_camera():
    camera = EquirectangularCamera(1024, 512)
    images = frames([seen_from(0, 0, 0, camera), seen_from(0.3, 0.2, 0.4, camera)], camera)

    def agreeing(rows):
        a, b = PlanarEpipolar(features=1500, panorama_rows=rows).extract(images)
        pose = relative_pose(a, b, np.random.default_rng(0))
        assert abs(wrap_angle(pose.phi - 0.4)) < np.deg2rad(1)
        for features in (a, b):  # the directions are those of the panorama, whatever its size
            azimuth = np.arctan2(features.directions[:, 1], features.directions[:, 0])
            np.testing.assert_allclose(wrap_angle(features.azimuth_level[:, 0] - azimuth), 0, atol=1e-5)
        return pose.agree.sum()

    assert agreeing(None) > 1.3 * agreeing(128)
    for rows in (31, 8192, 0):
        with pytest.raises(ConfigError, match=f"panorama_rows={rows} is out of range"):
            PlanarEpipolar(panorama_rows=rows)


def test_surfaces_that_cannot_be():
    circle = ImageCircle(64, 64, Circle(31.5, 31.5, 30))
    with pytest.raises(DataError, match="surface=tiles needs a camera model, and a ImageCircle is none; give panorama"):
        surface_features(frames([np.zeros((64, 64), np.uint8)], circle), FeatureSurface.tiles, Detector.sift, 400, 12)
    with pytest.raises(ConfigError, match="panorama_rows=200 is no size of surface=image; leave one out"):
        PlanarEpipolar(panorama_rows=200, surface=FeatureSurface.image)
    black, flat = (np.full((480, 480), level, np.uint8) for level in (0, 90))
    for surface in (FeatureSurface.image, FeatureSurface.tiles):
        reasons = [found.reason for found in PlanarEpipolar(surface=surface).extract(frames([black, flat], MIRROR))]
        assert reasons == ["black", "flat: one grey level"]


def test_features_that_no_memory_holds_are_refused(monkeypatch):
    monkeypatch.setattr("omnilab.limits.free_memory", lambda: 1e8)
    images = frames([np.zeros((250, 250), np.uint8)], HyperbolicMirror(crop=0.9))
    with pytest.raises(
        ConfigError, match=r"the features of a panorama of 4000 x 16000 pixels take .* give fewer panorama_rows"
    ):
        PlanarEpipolar(panorama_rows=4000).extract(images)


@pytest.mark.parametrize("detector", [Detector.surf, Detector.sift, Detector.plain_sift])
def test_features_of_other_kinds_give_the_motion_too(pair, detector):
    odometry = PlanarEpipolar(detector=detector, tolerance_deg=1.0)
    a, b, _ = odometry.extract(pair)
    motion = relative_pose(a, b, np.random.default_rng(0), tolerance_deg=1.0)
    assert abs(wrap_angle(motion.phi - 0.3)) < np.deg2rad(1)
    assert abs(wrap_angle(motion.beta - 1.2)) < np.deg2rad(8)


def test_a_repeated_image_shows_no_parallax(pair):
    odometry = PlanarEpipolar()
    features = odometry.extract(pair.at(0))[0]
    motion = odometry.estimate(features, features, np.random.default_rng(0))
    assert "no parallax" in motion.failed
    assert np.isnan(motion.vector[:2]).all()
    assert abs(motion.vector[2]) < 1e-6


def test_images_in_which_there_is_nothing_are_unusable():
    shape = (480, 480)
    black, grey = np.zeros(shape, np.uint8), np.full(shape, 90, np.uint8)
    plain = np.broadcast_to(np.linspace(20, 200, 480).astype(np.uint8), shape)
    features = PlanarEpipolar().extract(frames([black, grey, plain], MIRROR))
    assert all(isinstance(f, Unusable) for f in features)
    assert features[0].reason == "black"
    assert "flat" in features[1].reason
    assert "features" in features[2].reason


def test_an_uncalibrated_camera_is_refused(pair):
    circle = ImageCircle(480, 480, Circle(239.5, 239.5, 200.0))
    with pytest.raises(DataError, match="calibration"):
        PlanarEpipolar().extract(frames(list(pair.images), circle))


def test_a_camera_without_a_floor_says_so():
    rng = np.random.default_rng(0)
    p, q = matches(rng, 100, 0.1, 0.2)
    up = p[:, 2] > 0.1

    def features_of(directions):
        vectors = np.eye(100, 128, dtype=np.uint8)[up] * 200
        return ImageFeatures(directions[up], np.zeros((up.sum(), 2)), vectors)

    motion = PlanarEpipolar().estimate(features_of(p), features_of(q), rng)
    assert motion.failed == "0 points of the floor"
    assert motion.vector[2] == pytest.approx(0.1, abs=1e-6)


def test_matches_are_mutual_and_clear():
    def features_of(vectors):
        n = len(vectors)
        return ImageFeatures(np.zeros((n, 3)), np.zeros((n, 2)), np.asarray(vectors, np.float32))

    before = features_of([[1, 0, 0], [0, 1, 0], [0.1, 0, 1], [0, 0, 1]])  # the third is nobody's best
    now = features_of([[0, 0.05, 1], [1, 0.05, 0], [0, 1, 0.07], [0, 1, -0.08]])  # the last two are alike
    i, j = match_features(before, now, 0.8)
    np.testing.assert_array_equal(i, [0, 3])
    np.testing.assert_array_equal(j, [1, 0])


@pytest.mark.parametrize(
    "wrong",
    [{"features": 0}, {"ratio": 1.5}, {"tolerance_deg": 0}, {"draws": 0}, {"least_matches": 2}, {"height_m": -1.0}],
    ids=str,
)
def test_settings_that_cannot_be_used_are_refused(wrong):
    with pytest.raises(ConfigError):
        PlanarEpipolar(**wrong)
