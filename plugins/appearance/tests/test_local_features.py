"""Local features and their distances on positions that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, rotate

from omnilab.api import ImageFeatures, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_descriptor
from omnilab_appearance import Features, FeaturesTurned, Sift, Surf
from omnilab_appearance.common.local_features import packed, unpacked
from omnilab_appearance.common.spherical_features import match_features

SIDE = 241


@pytest.fixture(scope="module")
def scene():
    """A picture full of blobs, black outside of its circle."""
    rng = np.random.default_rng(3)
    layers = [s * gaussian_filter(rng.standard_normal((SIDE, SIDE)), s) for s in (2, 4, 8)]
    picture = 127 + 40 * np.sum(layers, axis=0) / np.std(layers[0]) / 3
    v, u = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    return np.where(np.hypot(u, v) < SIDE / 2 - 2, np.clip(picture, 0, 255), 0)


@pytest.mark.parametrize("descriptor", [Sift(), Surf()], ids=repr)
def test_the_contract(descriptor):
    check_descriptor(descriptor)


def signatures(positions, vectors, count=None):
    """From (x, y) about the centre of a picture of 101 x 101 pixels."""
    uv = np.asarray(positions, float) * [1, -1] + 50
    return packed([(uv, np.asarray(vectors, float))], count or len(uv), np.shape(vectors)[1], (101, 101))


def test_features_lie_about_the_centre():
    found = unpacked(signatures([[3, 4], [-5, 6]], np.eye(2), count=4))
    np.testing.assert_array_equal(found.xy[0], [[3, 4], [-5, 6], [0, 0], [0, 0]])
    np.testing.assert_array_equal(found.valid[0], [1, 1, 0, 0])
    np.testing.assert_array_equal(found.vectors[0, :2], np.eye(2))


def test_the_distance_is_equation_4_5():
    place = signatures([[0, 0], [10, 0], [20, 20]], np.eye(3))
    query = signatures([[20, 24], [3, 4], [16, 0]], np.eye(3)[[2, 0, 1]])
    match = Features().match(query, Features().prepare(place))
    np.testing.assert_allclose(match.distance, [[1 / (1 / 5 + 1 / 6 + 1 / 4)]], rtol=1e-6)
    assert match.rotation_rad is None


def test_an_ambiguous_feature_is_no_match():
    place = signatures([[0, 0], [10, 0], [20, 20]], [[1, 0], [0.99, 0.14], [0, 1]])
    query = signatures([[3, 4], [20, 21]], [[1, 0.07], [0, 1]])
    match = Features().match(query, Features().prepare(place))
    np.testing.assert_allclose(match.distance, [[1]], rtol=1e-5)


@given(st.floats(-np.pi, np.pi), st.integers(0, 5))
@settings(max_examples=30)
def test_the_rotation_that_most_matches_agree_on_is_found(turn, wrong):
    rng = np.random.default_rng(1)
    xy = rng.uniform(-40, 40, (20, 2))
    c, s = np.cos(turn), np.sin(turn)
    seen = xy @ [[c, -s], [s, c]]  # the camera turned to the left: what it sees turns to the right
    seen[:wrong] = rng.uniform(-40, 40, (wrong, 2))
    vectors = np.eye(20)
    match = FeaturesTurned().match(signatures(seen, vectors), FeaturesTurned().prepare(signatures(xy, vectors)))
    assert abs(np.angle(np.exp(1j * (match.rotation_rad[0, 0] - turn)))) < 0.1
    if wrong == 0:
        assert abs(np.angle(np.exp(1j * (match.rotation_rad[0, 0] - turn)))) < 1e-5
        np.testing.assert_allclose(match.distance[0, 0], 0.1 / 20, rtol=1e-3)


@pytest.mark.parametrize(("descriptor", "within_deg"), [(Sift(), 0.5), (Surf(threshold=0.01), 3.0)], ids=repr)
@pytest.mark.parametrize("turn_deg", [0, 37, -120])
def test_a_turned_picture_tells_its_angle(scene, descriptor, within_deg, turn_deg):
    turned = np.rint(rotate(scene, -turn_deg, reshape=False, order=3)).clip(0, 255)  # scipy turns counter-clockwise
    query, place, other = (
        descriptor.describe(picture.astype(np.uint8)[None]) for picture in (turned, scene, scene[:, ::-1])
    )
    places = Signatures(np.concatenate([place.place, other.place]))
    match = FeaturesTurned().match(query, FeaturesTurned().prepare(places))
    assert match.distance[0].argmin() == 0
    assert abs(np.rad2deg(match.rotation_rad[0, 0]) - turn_deg) < within_deg


def test_black_pictures_are_far_from_all():
    black = Sift(features=5).describe(np.zeros((2, 64, 64), np.uint8))
    for distance in (Features(), FeaturesTurned()):
        match = distance.match(black, distance.prepare(black))
        np.testing.assert_array_equal(match.distance, 1e6)


def test_other_signatures_are_refused():
    with pytest.raises(DataError, match="hold no local features; choose descriptor=sift"):
        Features().prepare(Signatures(np.ones((2, 5, 8), np.float32) * 0.5))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Features(ratio=0),
        lambda: Sift(features=0),
        lambda: Sift(contrast=0),
        lambda: Surf(threshold=0),
        lambda: Surf(features=0),
    ],
)
def test_settings_that_mean_nothing(make):
    with pytest.raises(ConfigError, match="give"):
        make()


@pytest.mark.parametrize("dimensions", [128, 400])  # float32 adds the products of 400 bytes no longer exactly
def test_matches_of_bytes_are_those_of_double_precision(dimensions):
    rng = np.random.default_rng(4)
    one = rng.integers(0, 256, (120, dimensions)).astype(np.uint8)
    noisy = one[rng.permutation(120)] + rng.normal(0, 40, (120, dimensions)) * rng.uniform(0, 8, (120, 1))
    other = np.clip(noisy, 0, 255).astype(np.uint8)
    one[7] = 0  # a vector without a direction is like no other
    unit = [
        v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1) for v in (one.astype(float), other.astype(float))
    ]
    cosine = unit[0] @ unit[1].T
    best, second = np.sort(cosine, axis=1)[:, [-1, -2]].T
    expected = (1 - best < 0.85**2 * (1 - second)) & (cosine.argmax(axis=0)[cosine.argmax(axis=1)] == np.arange(120))
    nowhere = np.zeros((120, 2), np.float32)
    i, j = match_features(ImageFeatures(None, nowhere, one), ImageFeatures(None, nowhere, other), 0.85)
    assert 20 < len(i) < 110
    np.testing.assert_array_equal(i, np.flatnonzero(expected))
    np.testing.assert_array_equal(j, cosine.argmax(axis=1)[expected])
