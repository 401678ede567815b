"""The compiled SIFT beside OpenCV's, on pictures that were turned, and in one thread or two."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from omnilab.errors import ConfigError
from omnilab_appearance import FeatureAltitude
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.sift import sift
from omnilab_appearance.common.sift.scale_space import blur

ROWS, COLUMNS = 240, 320
EVERYWHERE = np.ones((ROWS, COLUMNS), bool)


@pytest.fixture(scope="module")
def picture():
    """Blots of many sizes (ROWS, COLUMNS)."""
    rng = np.random.default_rng(0)
    layers = [gaussian_filter(rng.standard_normal((ROWS, COLUMNS)), sigma) for sigma in (1.5, 3, 6, 12)]
    return np.clip(127 + sum(28 * layer / layer.std() for layer in layers), 0, 255).astype(np.uint8)


def cosines(a, b):
    a, b = a.astype(float), b.astype(float)
    return (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)


def nearest(uv, others):
    apart = np.linalg.norm(uv[:, None] - others[None], axis=-1)
    return apart.argmin(axis=1), apart.min(axis=1)


def test_it_finds_and_describes_what_opencv_does(picture):
    uv, vectors = sift(picture, EVERYWHERE, 150, 0.02, upright=True)
    opencv = cv2.SIFT_create(nfeatures=0, contrastThreshold=0.02, enable_precise_upscale=True)
    points = opencv.detect(picture, None)
    for point in points:
        point.angle = 0.0
    points, theirs = opencv.compute(picture, points)
    which, apart = nearest(uv, np.array([point.pt for point in points]))
    same = apart < 0.1  # pixels; OpenCV doubles the picture in another way, and a few extrema come and go by that
    assert same.mean() > 0.85
    assert np.percentile(cosines(vectors[same], theirs[which[same]]), 10) > 0.97


@pytest.mark.parametrize("doubled", [True, False])
def test_every_keypoint_comes_once(picture, doubled):
    uv, _ = sift(picture, EVERYWHERE, 10_000, 0.001, upright=True, doubled=doubled)
    assert len(uv) > 300
    assert len(np.unique(uv, axis=0)) == len(uv)


def test_a_picture_blurred_in_parts_is_the_same_as_in_one(picture):
    whole, parts = np.empty((2, ROWS, COLUMNS), np.float32)
    for sigma in (1.25, 3.09):
        blur(picture.astype(np.float32), sigma, whole, 0, ROWS)
        for first, last in itertools.pairwise((0, 3, 20, 120, ROWS)):
            blur(picture.astype(np.float32), sigma, parts, first, last)
        np.testing.assert_array_equal(parts, whole)


@pytest.mark.parametrize("sigma", [1.25, 1.52, 1.55, 3.09])
@pytest.mark.parametrize("shape", [(67, 64), (66, 61), (17, 51), (40, 1030), (100, 23)])
def test_blurs_are_opencvs(sigma, shape):
    picture = np.random.default_rng(0).uniform(0, 255, shape).astype(np.float32)
    side, out = 2 * int(np.ceil(3 * sigma)) + 1, np.empty(shape, np.float32)
    blur(picture, sigma, out, 0, len(picture))
    np.testing.assert_allclose(out, cv2.GaussianBlur(picture, (side, side), sigma), rtol=0, atol=1e-4)


@pytest.mark.parametrize("doubled", [True, False])
def test_a_quarter_turn_turns_the_keypoints_and_leaves_their_vectors(picture, doubled):
    uv, vectors = sift(picture, EVERYWHERE, 100, 0.02, doubled=doubled)
    turned, again = sift(np.ascontiguousarray(np.rot90(picture)), EVERYWHERE.T, 100, 0.02, doubled=doubled)
    which, apart = nearest(np.stack([turned[:, 1] * -1 + COLUMNS - 1, turned[:, 0]], -1), uv)
    assert (apart < 0.3).mean() > 0.9
    assert np.median(cosines(again[apart < 0.3], vectors[which[apart < 0.3]])) > 0.97


def test_a_blot_is_found_where_it_is():
    v, u = np.mgrid[:ROWS, :COLUMNS]
    blot = 20 + 200 * np.exp(-((u - 150.3) ** 2 + (v - 99.6) ** 2) / (2 * 4.0**2))
    uv, _ = sift(np.rint(blot).astype(np.uint8), EVERYWHERE, 1, 0.02)
    np.testing.assert_allclose(uv, [[150.3, 99.6]], atol=0.05)


def test_the_strongest_come_first_none_outside_the_mask_and_none_of_a_plain_picture(picture):
    few, _ = sift(picture, EVERYWHERE, 20, 0.02)
    many, _ = sift(picture, EVERYWHERE, 60, 0.02)
    np.testing.assert_array_equal(few, many[:20])
    mask = EVERYWHERE.copy()
    mask[:, :160] = False
    assert sift(picture, mask, 60, 0.02)[0][:, 0].min() > 159
    for plain in (np.full((ROWS, COLUMNS), 90, np.uint8), np.full((4, 5), 90, np.uint8)):
        uv, vectors = sift(plain, np.ones(plain.shape, bool), 60, 0.02)
        assert uv.shape == (0, 2)
        assert vectors.shape == (0, 128)


def test_two_threads_find_the_same_as_one(picture):
    large = cv2.resize(picture, (700, 500))
    found, threads = [], cv2.getNumThreads()
    try:
        for count in (1, 2):
            cv2.setNumThreads(count)
            found.append(sift(large, np.ones(large.shape, bool), 300, 0.005))
    finally:
        cv2.setNumThreads(threads)
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)


def test_an_altimeter_that_has_other_features_says_so():
    with pytest.raises(ConfigError, match="detector=fast_sift is of odometries; give surf or sift"):
        FeatureAltitude(Detector.fast_sift)
