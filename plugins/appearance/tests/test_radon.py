"""The Radon transform against scikit-image, closed forms and exact turns."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from skimage.transform import radon as skimage_radon

from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_descriptor
from omnilab_appearance import Radon
from omnilab_appearance.common.image_ops import shrunk
from omnilab_appearance.descriptors.radon import line_integrals, shrink


def _pictures(count, side, seed=0, sigma=2.0):
    rng = np.random.default_rng(seed)
    noise = np.stack([gaussian_filter(rng.standard_normal((side, side)), sigma) for _ in range(count)])
    return np.clip(127 + 90 * noise / noise.std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("radon", [Radon(), Radon(offsets=61, angles=36), Radon(offsets=120, angles=48)])
def test_keeps_the_contract(radon):
    check_descriptor(radon)


@pytest.mark.parametrize("size", [101, 250])
def test_equals_scikit_image_at_the_images_own_resolution(size):
    axis = np.arange(size) - size // 2  # the point that scikit-image turns about
    inside = axis[:, None] ** 2 + axis[None, :] ** 2 <= (size / 2 - 2) ** 2
    image = (_pictures(1, size)[0] * inside).astype(np.float32)
    angles = np.arange(0, 180, 7.0)
    reference = skimage_radon(image, theta=angles, circle=True)
    ours = line_integrals(image[..., None], np.deg2rad(angles), center=size // 2)[0]
    rms = np.sqrt(np.mean((ours - reference) ** 2) / np.mean(reference**2))
    assert rms < 5e-3


@given(st.floats(0, 2 * np.pi), st.floats(0, 0.8))
@settings(max_examples=25)
def test_a_point_traces_the_sine_of_its_polar_coordinates(azimuth, radius):
    n = 101
    x, y = 50 * radius * np.cos(azimuth), 50 * radius * np.sin(azimuth)
    v, u = np.mgrid[:n, :n]
    blob = 200 * np.exp(-((u - 50 - x) ** 2 + (50 - v - y) ** 2) / 8)
    values = Radon(offsets=n, angles=72).describe(blob[None].astype(np.uint8)).place[0]
    angles = 2 * np.pi * np.arange(72) / 72
    expected = 50 + x * np.cos(angles) + y * np.sin(angles)
    centroid = (values * np.arange(n)[:, None]).sum(0) / values.sum(0)
    assert np.abs(centroid - expected).max() < 0.15


def test_a_disc_has_the_chord_lengths_of_a_disc():
    v, u = np.mgrid[:201, :201] - 100
    disc = (100 * (u**2 + v**2 <= 60**2)).astype(np.uint8)
    values = Radon(offsets=201, angles=40).describe(disc[None]).place[0]
    offsets = np.arange(201) - 100
    chords = 200 * np.sqrt(np.maximum(0, 60.0**2 - offsets**2))
    clear = np.abs(np.abs(offsets) - 60) > 3  # a rim of pixels is no rim of a disc
    assert np.abs(values - chords[:, None])[clear].max() < 0.03 * chords.max()
    assert np.allclose(values.sum(0), disc.sum(), rtol=1e-3)


def test_opposite_directions_mirror_the_offsets():
    values = Radon(offsets=60, angles=36).describe(_pictures(2, 60)).place
    odd = Radon(offsets=60, angles=9).describe(_pictures(2, 60)).place  # no halves are shared here
    assert np.array_equal(values[:, ::-1, :18], values[:, :, 18:])
    assert np.allclose(odd, values[:, :, ::4], rtol=1e-5, atol=1e-2)


def test_shrinking_keeps_the_scale_of_the_integrals():
    picture = _pictures(1, 200, sigma=6.0)
    full, small = (Radon(offsets=n, angles=36).describe(picture).place[0] for n in (200, 50))
    assert np.abs(full.reshape(50, 4, 36).mean(1) - small).max() < 0.03 * full.max()


def test_only_the_inscribed_circle_counts():
    picture = _pictures(1, 64)
    v, u = np.mgrid[:64, :64] - 31.5
    painted = np.where(u**2 + v**2 > 32**2, 255, picture).astype(np.uint8)
    assert np.array_equal(Radon(64, 36).describe(picture).place, Radon(64, 36).describe(painted).place)
    assert shrink(picture, 64)[0, 0, 0] == 0


def test_unusable_sizes_and_images_are_refused():
    with pytest.raises(ConfigError, match="offsets=2 is out of range; give a whole number from 4"):
        Radon(offsets=2)
    with pytest.raises(DataError, match=r"\(2, 10, 12\)"):
        Radon().describe(np.zeros((2, 10, 12), np.uint8))
    assert Radon(60, 36).describe(np.zeros((0, 9, 9), np.uint8)).place.shape == (0, 60, 36)


@pytest.mark.parametrize("offsets", [4, 31, 173])
def test_an_image_alone_has_the_transform_it_has_among_others(offsets):
    pictures = _pictures(3, 200)
    together = Radon(offsets=offsets).describe(pictures).place
    for picture, transform in zip(pictures, together, strict=True):
        np.testing.assert_array_equal(Radon(offsets=offsets).describe(picture[None]).place[0], transform)


@given(st.integers(4, 60), st.integers(0, 400), st.integers(0, 9))
@settings(max_examples=40, deadline=None)
def test_averages_over_cells_are_those_of_opencv(size, more, seed):
    image = np.random.default_rng(seed).integers(0, 256, (size + more, size + more), np.uint8)
    reference = cv2.resize(image.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(shrunk(image, size), reference, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("center", [43.0, 30.5])
def test_one_image_alone_has_the_integrals_that_it_has_in_a_batch(center):
    images = np.random.default_rng(0).random((87, 87, 2)).astype(np.float32)
    directions = 2 * np.pi * np.arange(45) / 90
    together = line_integrals(images, directions, center)
    for k in range(2):
        np.testing.assert_array_equal(line_integrals(images[..., k : k + 1], directions, center)[0], together[k])
