"""Descriptors against what a user would write with numpy, scipy and scikit-image, and against exact turns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.feature import hog
from skimage.filters import gabor_kernel

from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_descriptor
from omnilab_appearance import (
    FourierPhase,
    FourierSignature,
    Gist,
    GistGrid,
    Hog,
    HogGrid,
    Radon,
    RadonGist,
    RadonGistGrid,
    RadonHog,
    RadonHogGrid,
    Ring,
    RingKey,
    TinyImage,
)
from omnilab_appearance.common.circular_correlation import best_rotations, heading_spectra
from omnilab_appearance.common.gabor import energies, kernel

RNG = np.random.default_rng(4)
PANORAMAS = RNG.integers(0, 256, (3, 128, 512), dtype=np.uint8)
MIRRORS = RNG.integers(0, 256, (3, 96, 96), dtype=np.uint8)
OF_PANORAMAS = [
    FourierSignature(),
    FourierPhase(),
    Hog(),
    HogGrid(),
    Gist(),
    GistGrid(),
    RingKey(),
    RingKey(frequencies=8),
    TinyImage(),
]
OF_MIRRORS = [Radon(), RadonGist(), RadonGistGrid(), RadonHog(), RadonHogGrid(), Ring()]
ALL = OF_PANORAMAS + OF_MIRRORS


@pytest.mark.parametrize("descriptor", ALL, ids=repr)
@pytest.mark.parametrize("color", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["grey", "colour"])
def test_the_contract(descriptor, color):
    check_descriptor(type(descriptor)(**(vars(descriptor) | {"color": color})))


@pytest.mark.parametrize("descriptor", ALL, ids=repr)
def test_colour_is_one_channel_after_the_other(descriptor):
    pictures = PANORAMAS if descriptor.view == "panorama" else MIRRORS
    colored = type(descriptor)(**(vars(descriptor) | {"color": True}))
    found = colored.describe(np.stack([pictures, pictures[::-1], 255 - pictures], -1))
    parts = np.concatenate([descriptor.describe(p).place for p in (pictures, pictures[::-1], 255 - pictures)], 1)
    np.testing.assert_allclose(found.place, parts, rtol=1e-5, atol=1e-3)


def test_an_image_alone_has_the_hog_it_has_among_others():
    together = Hog().describe(PANORAMAS)
    for picture, place, heading in zip(PANORAMAS, together.place, together.heading, strict=True):
        alone = Hog().describe(picture[None])
        np.testing.assert_array_equal(alone.place[0], place)
        np.testing.assert_array_equal(alone.heading[0], heading)


@settings(max_examples=20)
@given(st.integers(1, 511))
def test_a_turn_changes_no_place_and_shifts_headings(columns):
    turned = np.roll(PANORAMAS, -columns, axis=2)
    for descriptor in (FourierSignature(), Hog(), RingKey(frequencies=8)):
        before, after = descriptor.describe(PANORAMAS), descriptor.describe(turned)
        np.testing.assert_allclose(after.place, before.place, rtol=1e-4, atol=1e-4 * before.place.max())
    signature = FourierSignature()
    queries, places = signature.describe(turned).heading, signature.describe(PANORAMAS).heading
    spectra = np.ascontiguousarray(heading_spectra(places).transpose(2, 1, 0))
    agreement, rotation = best_rotations(heading_spectra(queries), spectra, places.shape[-1])
    error = np.angle(np.exp(1j * (rotation.diagonal() - 2 * np.pi * columns / 512)))
    assert np.abs(np.rad2deg(error)).max() < 0.3
    assert (agreement.diagonal() > 0.9).all()


def test_the_fourier_signature_is_numpys_row_by_row():
    found = FourierSignature(rows=128, magnitudes=20).describe(PANORAMAS).place
    for image, signature in zip(PANORAMAS, found, strict=True):
        rows = np.array([np.abs(np.fft.fft(row.astype(float)))[:20] for row in image])
        np.testing.assert_allclose(signature, rows, rtol=1e-4, atol=0.05)


@pytest.mark.parametrize(("cells", "bins"), [(16, 8), (4, 9), (1, 36)])
def test_hog_is_that_of_scikit_image(cells, bins):
    found = Hog(cells=cells, bins=bins).describe(PANORAMAS[:1]).place
    for image, signature in zip(PANORAMAS[:1].astype(float), found, strict=True):
        wrapped = np.pad(image, ((0, 0), (1, 1)), mode="wrap")
        # its cells of a row each, of the wrapped image, less the two columns that were added
        reference = hog(wrapped, bins, (1, 1), (1, 1), block_norm="L2-Hys", feature_vector=False)
        assert reference.shape == (128, 514, 1, 1, bins)
        strength = _strength(wrapped)[:, 1:-1, None]
        single = strength * (reference[:, 1:-1, 0, 0] > 0)
        expected = single.reshape(cells, -1, bins).mean(1)
        np.testing.assert_allclose(signature, expected, rtol=1e-3, atol=0.05)


def _strength(image):
    down, across = np.zeros_like(image), np.zeros_like(image)
    down[1:-1] = image[2:] - image[:-2]
    across[:, 1:-1] = image[:, 2:] - image[:, :-2]
    return np.hypot(down, across)


@pytest.mark.parametrize("frequency", [0.1, 0.2, 0.35])
@pytest.mark.parametrize("orientation", [0.0, 0.7, 2.0])
def test_filters_are_those_of_scikit_image(frequency, orientation):
    ours = kernel(frequency, orientation)
    theirs = gabor_kernel(frequency, orientation, bandwidth=1, n_stds=5)
    reach, far = len(ours) // 2, np.array(theirs.shape) // 2
    common = np.minimum(reach, far)
    window = theirs[far[0] - common[0] : far[0] + common[0] + 1, far[1] - common[1] : far[1] + common[1] + 1]
    mine = ours[reach - common[0] : reach + common[0] + 1, reach - common[1] : reach + common[1] + 1]
    np.testing.assert_allclose(mine, window, atol=1e-9 + 1e-6 * np.abs(ours).max())


def test_responses_are_convolutions_that_wrap_around():
    from scipy.ndimage import convolve

    pictures = RNG.random((2, 40, 64)).astype(np.float32)
    found = energies(pictures, 3, 0.2)
    for picture, responses in zip(pictures, found, strict=True):
        for m, response in enumerate(responses):
            taps = kernel(0.2, np.pi * m / 3)
            wrapped = np.pad(picture.astype(float), ((0, 0), (20, 20)), mode="wrap")
            parts = [convolve(wrapped, part)[:, 20:-20] for part in (taps.real, taps.imag)]
            np.testing.assert_allclose(response, np.hypot(*parts), atol=1e-5)


def test_gist_tells_stripes_by_their_direction():
    columns = np.broadcast_to(128 + 100 * np.sin(2 * np.pi * 0.2 * np.arange(512) * 102.4 / 102.4), (128, 512))
    upright = np.clip(columns, 0, 255).astype(np.uint8)[None]
    place = Gist(rows=128, orientations=4).describe(upright).place[0, 0].mean(-1)
    assert place.argmax() == 0
    assert place[0] > 5 * place[2]


def test_the_ring_key_holds_the_rings_means():
    place = RingKey(rings=8).describe(PANORAMAS).place
    np.testing.assert_allclose(place[..., 0], PANORAMAS.reshape(3, 8, 16, 512).mean((2, 3)), rtol=1e-4)


def test_a_tiny_image_holds_means():
    place = TinyImage(rows=4, columns=8).describe(PANORAMAS).place
    np.testing.assert_allclose(place, PANORAMAS.reshape(3, 4, 32, 8, 64).mean((2, 4)), rtol=1e-4)


def test_ring_forgets_where_things_are_along_the_offsets():
    image = np.zeros((2, 97, 97), np.uint8)
    image[0, 40:50, 44:54] = 200
    image[1, 46:56, 39:49] = 200
    first, second = Ring(offsets=97, angles=60).describe(image).place
    radon = Radon(offsets=97, angles=60).describe(image).place
    assert np.abs(first - second).mean() < 0.05 * np.abs(first).mean()
    assert np.abs(radon[0] - radon[1]).mean() > 0.5 * np.abs(radon[0]).mean()


@pytest.mark.parametrize("descriptor", ALL, ids=repr)
@pytest.mark.parametrize(
    "images", [np.zeros((2, 64, 64, 3), np.uint8), np.zeros((2, 64, 64)), np.zeros((64, 64), np.uint8)]
)
def test_pictures_of_another_kind_are_refused(descriptor, images):
    with pytest.raises(DataError, match=r"give \(N, H, W\) uint8"):
        descriptor.describe(images)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: FourierSignature(rows=0), "rows=0"),
        (lambda: FourierSignature(phases=0), "phases=0"),
        (lambda: Gist(blocks=0), "blocks=0"),
        (lambda: Gist(frequency=0.7), "frequency=0.7"),
        (lambda: Gist(width=3), "width=3 is out of range; give an even number from 2"),
        (lambda: Hog(bins=0), "bins=0"),
        (lambda: RadonGist(levels=6), "levels=6"),
        (lambda: RadonHog(cells=200), "cells=200"),
        (lambda: Ring(frequencies=100), "frequencies=100"),
        (lambda: RingKey(rings=0), "rings=0"),
        (lambda: TinyImage(columns=0), "columns=0"),
    ],
)
def test_settings_that_describe_nothing_are_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make()


@pytest.mark.parametrize(
    ("descriptor", "words"),
    [
        (FourierSignature(rows=200), "rows=200 are more than the 128 rows"),
        (FourierSignature(magnitudes=300), "512 columns has 257 frequencies"),
        (FourierPhase(frequencies=257), "257 frequencies, not 258"),
        (Hog(cells=129), "129 blocks cannot be cut from 128 rows"),
        (Hog(spacing=7), "a spacing that divides it"),
        (HogGrid(columns=600), "smaller than 64 x 600"),
        (HogGrid(cells=65), "65 blocks cannot be cut from 64 rows"),
        (HogGrid(spacing=7), "a spacing that divides it"),
        (GistGrid(blocks=17), "17 blocks cannot be cut from 16 rows"),
        (Gist(width=1024), "a width up to 512"),
        (RingKey(frequencies=300), "257 frequencies, not 300"),
        (TinyImage(columns=600), "smaller than 16 x 600"),
    ],
    ids=repr,
)
def test_settings_that_do_not_fit_the_pictures_are_refused(descriptor, words):
    with pytest.raises(DataError, match=words):
        descriptor.describe(PANORAMAS)
