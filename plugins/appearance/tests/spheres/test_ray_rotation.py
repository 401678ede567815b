"""Rotations from matched rays: against scipy, known motions, and exactly rotated spheres."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from omnilab.api import Floats, Signatures
from omnilab.cameras import EquirectangularCamera, reproject
from omnilab.errors import DataError
from omnilab.testing import check_descriptor, check_distance
from omnilab_appearance import EpipolarRotation, FeatureRotation, SphericalSift
from omnilab_appearance.common.ray_rotation import relative_orientation, robust_rotation, wahba

TOLERANCE_RAD = np.deg2rad(1.0)


def error_deg(A: Floats, B: Floats) -> float:
    return float(np.rad2deg(Rotation.from_matrix(A.T @ B).magnitude()))


def noisy(points: Floats, noise_deg: float, rng: np.random.Generator) -> Floats:
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    directions = directions + np.deg2rad(noise_deg) * rng.standard_normal(points.shape)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def rays(rng: np.random.Generator, t: Floats, noise_deg: float, wrong: float) -> tuple[Floats, Floats, Floats]:
    """R, and 120 matched directions of points 2 to 6 m away seen from the origin and from t, rotated by R; some wrong."""
    R = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    points = rng.standard_normal((120, 3))
    points *= rng.uniform(2, 6, (120, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    p, q = (noisy(seen, noise_deg, rng) for seen in (points, (points - t) @ R))
    q[: int(wrong * 120)] = rng.permutation(q[: int(wrong * 120)])
    return R, p, q


@settings(max_examples=20)
@given(st.integers(0, 2**31))
def test_wahbas_problem_is_scipys_alignment(seed):
    rng = np.random.default_rng(seed)
    p, q, weights = rng.standard_normal((6, 3)), rng.standard_normal((6, 3)), rng.uniform(0.1, 2, 6)
    expected = Rotation.align_vectors(p, q, weights)[0].as_matrix()
    np.testing.assert_allclose(wahba(p, q, weights), expected, atol=1e-9)


@settings(max_examples=8)
@given(st.integers(0, 2**31))
def test_a_rotation_is_found_among_wrong_matches(seed):
    rng = np.random.default_rng(seed)
    R, p, q = rays(rng, np.zeros(3), 0.1, 0.5)
    found, agree = robust_rotation(p, q, rng, TOLERANCE_RAD, 300)
    assert error_deg(found, R) < 0.1
    assert agree[60:].mean() > 0.98
    assert agree[:60].mean() < 0.1


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.3, 1.0]))
def test_a_translation_costs_the_epipolar_constraint_nothing(seed, length_m):
    rng = np.random.default_rng(seed)
    t = rng.standard_normal(3)
    R, p, q = rays(rng, length_m * t / np.linalg.norm(t), 0.1, 0.4)
    found, agree = relative_orientation(p, q, rng, TOLERANCE_RAD, 300, 12)
    assert error_deg(found, R) < 0.5
    assert agree[48:].mean() > 0.95
    if length_m == 1.0:
        alone, _ = robust_rotation(p, q, np.random.default_rng(seed), TOLERANCE_RAD, 300)
        assert error_deg(alone, R) > error_deg(found, R)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 1.0, 3.0]))
def test_headings_of_upright_cameras_are_found_whatever_the_parallax(seed, length_m):
    rng = np.random.default_rng(seed)
    R, bearing = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix(), rng.uniform(-np.pi, np.pi)
    points = rng.standard_normal((90, 3))
    points *= rng.uniform(2, 4, (90, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    t = length_m * np.array([np.cos(bearing), np.sin(bearing), 0])
    p, q = (noisy(seen, 0.1, rng) for seen in (points, (points - t) @ R))
    q[:60] = noisy(rng.standard_normal((60, 3)), 0.0, rng)
    found, agree = EpipolarRotation(planar=True).rotation(p, q)
    assert error_deg(found, R) < 1
    assert agree[60:].mean() > 0.9
    assert agree[:60].mean() < 0.2


def test_too_few_matches_of_upright_cameras_are_no_rotation():
    R, agree = EpipolarRotation(planar=True).rotation(*np.eye(3)[None].repeat(2, axis=0))
    np.testing.assert_array_equal(R, np.eye(3))
    assert agree.tolist() == [False] * 3


def spheres(rng: np.random.Generator, R: Floats | None = None) -> Floats:
    """A sphere of blobs (1, 128, 256), or as a camera rotated by R sees it: blobs are where they are, exactly."""
    camera = EquirectangularCamera(256, 128)
    directions = camera.directions(np.stack(np.meshgrid(np.arange(256.0), np.arange(128.0)), -1))
    centres = rng.standard_normal((150, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    sharpness, height = rng.uniform(100, 1500, 150), rng.uniform(-90, 90, 150)
    own = directions if R is None else directions @ R.T
    values = 128 + np.exp(sharpness * (own @ centres.T - 1)) @ height
    return np.clip(np.rint(values), 1, 255).astype(np.uint8)[None]


def test_rotated_spheres_are_recovered_by_their_features():
    R = Rotation.from_rotvec([1.1, -0.7, 2.0]).as_matrix()
    place, query = (SphericalSift().describe(spheres(np.random.default_rng(3), turn)) for turn in (None, R))
    both = Signatures(np.concatenate([SphericalSift().describe(spheres(np.random.default_rng(4))).place, place.place]))
    for distance in (FeatureRotation(), EpipolarRotation()):
        match = distance.match(query, distance.prepare(both))
        assert match.distance[0].argmin() == 1
        assert error_deg(match.R_place_query[0, 1], R) < 0.5
        expected = np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
        assert match.rotation_rad[0, 1] == pytest.approx(expected, abs=0.01)


def test_the_contracts():
    check_descriptor(SphericalSift(features=50))
    pictures = np.concatenate([spheres(np.random.default_rng(seed)) for seed in range(5)])
    signatures = SphericalSift(features=60).describe(pictures)
    check_distance(EpipolarRotation(starts=1, draws=50), signatures, equivariant=False)


def test_features_are_only_where_something_is_seen():
    picture = spheres(np.random.default_rng(5))
    picture[:, :50] = 0
    found = SphericalSift().describe(picture).place[0]
    directions = found[np.abs(found[:, :3]).sum(axis=1) > 0, :3]
    assert len(directions) > 20
    assert directions[:, 2].max() < np.sin(np.deg2rad(90 - 180 * 50 / 128))
    camera = EquirectangularCamera(256, 128)
    turned = reproject(picture, camera, camera, Rotation.from_euler("z", 30, degrees=True).as_matrix())
    assert (turned[:, :48] == 0).all()
    assert np.abs(SphericalSift().describe(np.zeros_like(picture)).place).max() == 0


def test_a_sphere_of_few_pixels_has_few_features_or_none():
    tiny = np.random.default_rng(6).integers(1, 256, (2, 8, 16), dtype=np.uint8)
    directions = SphericalSift().describe(tiny).place[:, :, :3]
    lengths = np.linalg.norm(directions, axis=-1)
    assert ((np.abs(lengths - 1) < 1e-6) | (lengths == 0)).all()


def test_signatures_of_others_are_refused_in_a_sentence():
    with pytest.raises(DataError, match="hold no features of the sphere; choose descriptor=spherical_sift"):
        FeatureRotation().prepare(Signatures(np.zeros((2, 9), np.float32)))
