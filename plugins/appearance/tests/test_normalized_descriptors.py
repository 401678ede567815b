"""Normalised gradients, gist and phases against scikit-image, numpy, and what gains and covers may change."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from skimage.feature import hog

from omnilab.api import Signatures
from omnilab.errors import DataError
from omnilab.testing import check_distance
from omnilab.testing.common import smooth_images
from omnilab_appearance import (
    CircularCorrelation,
    FourierPhase,
    GistGrid,
    Hog,
    HogGrid,
    Radon,
    RadonGistGrid,
    RadonHogGrid,
    TinyImage,
)
from omnilab_appearance.common.block_norm import BlockNorm
from omnilab_appearance.descriptors.radon import one_side

RNG = np.random.default_rng(9)
PANORAMAS = RNG.integers(20, 200, (2, 128, 512), dtype=np.uint8)
OF_SCIKIT = {BlockNorm.l1: "L1", BlockNorm.l1_sqrt: "L1-sqrt", BlockNorm.l2: "L2", BlockNorm.l2_hys: "L2-Hys"}
GRIDS = [HogGrid(floor=0), GistGrid(floor=0), FourierPhase()]
MIRRORS = RNG.integers(20, 200, (2, 96, 96), dtype=np.uint8)
OF_RADON = [RadonHogGrid(), RadonGistGrid()]


def bordered(panoramas):
    """Panoramas without gradients at the seam, where those of scikit-image do not go on around the camera."""
    plain = panoramas.copy()
    plain[:, :, :2] = plain[:, :, -2:] = 90
    return plain


@pytest.mark.parametrize("norm", OF_SCIKIT, ids=lambda norm: norm.value)
@pytest.mark.parametrize(("cells", "bins", "block"), [(16, 8, 2), (8, 9, 4), (4, 9, 1)])
def test_normalised_hog_is_that_of_scikit_image(norm, cells, bins, block):
    images = bordered(PANORAMAS)
    found = Hog(cells=cells, bins=bins, norm=norm, block=block).describe(images).place
    for image, signature in zip(images.astype(float), found, strict=True):
        overlapping = hog(
            image, bins, (128 // cells, 512), (block, 1), block_norm=OF_SCIKIT[norm], feature_vector=False
        )
        expected = overlapping[::block].reshape(
            cells, bins
        )  # its blocks begin at each cell, those of the thesis part them
        np.testing.assert_allclose(signature, expected, rtol=1e-3, atol=1e-5)


def test_without_a_norm_hog_is_what_it_was():
    plain = Hog().describe(PANORAMAS).place
    assert np.array_equal(Hog(block=4).describe(PANORAMAS).place, plain)
    assert plain.max() > 2  # grey levels a pixel, not shares


def test_blocks_that_do_not_divide_the_cells_are_refused():
    with pytest.raises(DataError, match="blocks of 3 cells do not divide 16 cells"):
        Hog(norm=BlockNorm.l2, block=3).describe(PANORAMAS)


@pytest.mark.parametrize("sigma", [0.0, 1.5])
def test_hog_in_a_grid_is_that_of_scikit_image(sigma):
    """Unsigned directions, cells that do not overlap, a block a cell: what scikit-image has, too."""
    grid = HogGrid(cells=8, bins=9, width=16, spacing=16, smoothing=sigma, signed=False, floor=0, rows=128, columns=512)
    for image, signature in zip(PANORAMAS.astype(float), grid.describe(PANORAMAS).place, strict=True):
        smooth = gaussian_filter1d(gaussian_filter1d(image, sigma, 1, mode="wrap"), sigma, 0) if sigma else image
        wrapped = np.pad(smooth, ((0, 0), (16, 16)), mode="wrap")
        cells = hog(wrapped, 9, (16, 16), (1, 1), block_norm="L2", feature_vector=False)[:, 1:-1, 0, 0]
        expected = cells.transpose(2, 0, 1).reshape(72, 32)  # bins, cells, columns
        np.testing.assert_allclose(signature, expected, rtol=1e-2, atol=2e-3)


@pytest.mark.parametrize("descriptor", GRIDS, ids=repr)
def test_a_gain_changes_nothing(descriptor):
    dim = (PANORAMAS // 4).astype(np.uint8)
    np.testing.assert_allclose(descriptor.describe(4 * dim).place, descriptor.describe(dim).place, rtol=1e-3, atol=1e-3)


def assert_alike(found, expected, atol=5e-3):
    """The same but for one gradient in a thousand, which rounding puts on the other side of the border of two bins."""
    assert np.mean(~np.isclose(found, expected, rtol=0, atol=atol)) < 1e-3


@settings(max_examples=5, deadline=None)
@given(st.integers(1, 4), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_a_gain_and_an_offset_of_grey_levels_change_nothing(gain, offset, seed):
    dim = np.random.default_rng(seed).integers(0, 50, (1, 128, 512), dtype=np.uint8)
    for descriptor in (*GRIDS, *OF_RADON):
        images = dim if descriptor.view == "panorama" else dim[:, :96, :96]
        before, after = descriptor.describe(images), descriptor.describe(gain * images + np.uint8(offset))
        if descriptor.view == "panorama":
            assert_alike(after.place, before.place)
        # the rim of a mirror image is one of pixels, which an offset shows
        match = CircularCorrelation().match(after, CircularCorrelation().prepare(before))
        assert match.distance[0, 0] < 2e-3
        assert abs(match.rotation_rad[0, 0]) < 1e-3


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 127))
def test_a_turn_of_whole_blocks_is_that_shift_exactly(turn):
    """Blocks begin every eighth column of 512; the phases have a sample every fourth."""
    turned = np.roll(PANORAMAS, -8 * turn, axis=2)
    for descriptor in (HogGrid(), GistGrid(), FourierPhase()):
        before, after = descriptor.describe(PANORAMAS), descriptor.describe(turned)
        samples = before.place.shape[-1]
        assert_alike(after.place, np.roll(before.place, -turn * samples // 64, axis=2))
        match = CircularCorrelation().match(after, CircularCorrelation().prepare(before))
        error = np.angle(np.exp(1j * (match.rotation_rad.diagonal() - 2 * np.pi * turn / 64)))
        assert np.abs(error).max() < 1e-3
        assert match.distance.diagonal().max() < 1e-3


@pytest.mark.parametrize("descriptor", OF_RADON, ids=repr)
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_quarter_turn_of_the_mirror_image_is_that_shift_exactly(descriptor, quarters):
    """Of the turns of a picture those that interpolate nothing."""
    before, after = descriptor.describe(MIRRORS), descriptor.describe(np.rot90(MIRRORS, -quarters, (1, 2)).copy())
    shift = quarters * before.place.shape[-1] // 4
    assert_alike(after.place, np.roll(before.place, -shift, axis=2))
    match = CircularCorrelation().match(after, CircularCorrelation().prepare(before))
    error = np.angle(np.exp(1j * (match.rotation_rad.diagonal() - quarters * np.pi / 2)))
    assert np.abs(error).max() < 1e-3
    assert match.distance.diagonal().max() < 1e-3


def test_one_side_of_the_radon_transform_holds_the_other():
    """R(d, phi + pi) = R(-d, phi): what the grids leave out is what they keep."""
    place = Radon(offsets=64, angles=128).describe(MIRRORS).place
    side = one_side(place)
    np.testing.assert_array_equal(side, place[:, 32:])
    np.testing.assert_allclose(np.roll(side, 64, axis=2), place[:, 31::-1], rtol=1e-6)


def test_hog_of_the_radon_transform_is_that_of_numpy():
    grid = RadonHogGrid(cells=4, bins=8, width=16, spacing=16, smoothing=0, floor=0, offsets=128, angles=128)
    found = grid.describe(MIRRORS).place.reshape(2, 8, 4, 8)
    for transform, signature in zip(Radon(128, 128).describe(MIRRORS).place, found, strict=True):
        side = (transform - transform.mean(axis=1, keepdims=True))[64:]
        down, across = np.zeros_like(side), np.roll(side, -1, 1) - np.roll(side, 1, 1)
        down[1:-1] = side[2:] - side[:-2]
        own = np.arctan2(down, across) % (2 * np.pi) // (np.pi / 4) == np.arange(8)[:, None, None]
        cells = (own * np.hypot(down, across)).reshape(8, 4, 16, 8, 16).mean((2, 4))
        assert_alike(signature, cells / np.linalg.norm(cells, axis=0))


@pytest.mark.parametrize("descriptor", [HogGrid(floor=0), GistGrid(floor=0)], ids=repr)
def test_what_is_covered_changes_its_own_cells_alone(descriptor):
    covered = PANORAMAS.copy()
    covered[:, :, 128:256] = 110
    before, after = descriptor.describe(PANORAMAS).place, descriptor.describe(covered).place
    columns = np.arange(before.shape[-1]) * 360 / before.shape[-1]
    far = (columns < 20) | (columns > 250)  # the cover lies from 90 to 180 degrees, and filters and cells reach beyond
    np.testing.assert_allclose(after[..., far], before[..., far], rtol=2e-3, atol=2e-3)
    assert np.abs(after - before)[..., ~far].max() > 0.1


def test_phases_are_those_of_numpy():
    found = FourierPhase(rows=128, frequencies=20).describe(PANORAMAS).place
    spectra = np.fft.rfft(PANORAMAS.astype(float))[:, :, 1:21]
    np.testing.assert_allclose(np.fft.rfft(found)[:, :, 1:21], spectra / np.abs(spectra), atol=1e-3)
    np.testing.assert_allclose(found.mean(-1), 0, atol=1e-6)


def test_rows_without_texture_have_no_phases():
    image = PANORAMAS[:1].copy()
    image[:, :64] = 100
    found = FourierPhase(rows=128).describe(image).place
    assert not found[:, :64].any()
    assert np.abs(found[:, 64:]).max() > 0.1


@pytest.mark.parametrize("descriptor", [HogGrid(), GistGrid(), FourierPhase()], ids=repr)
def test_the_distance_finds_the_turn(descriptor):
    images = smooth_images("panorama", False)
    index = CircularCorrelation().prepare(descriptor.describe(images))
    turned = np.roll(images, -images.shape[2] // 8, axis=2)
    match = CircularCorrelation().match(descriptor.describe(turned), index)
    assert np.array_equal(match.distance.argmin(1), np.arange(len(images)))
    np.testing.assert_allclose(match.rotation_rad.diagonal(), np.pi / 4, atol=np.deg2rad(1))


def test_the_distance_keeps_the_contract():
    check_distance(CircularCorrelation())


def test_the_distance_is_the_highest_correlation_over_all_shifts():
    places, queries = RNG.random((3, 4, 20)).astype(np.float32), RNG.random((2, 4, 20)).astype(np.float32)
    queries[1] = 7 * np.roll(places[2], -5, axis=-1) + 3
    found = CircularCorrelation().match(Signatures(queries), CircularCorrelation().prepare(Signatures(places)))

    def unit(rows):
        rows = rows - rows.mean(-1, keepdims=True)
        # at an even number of samples the highest frequency, whose shift has two signs, is left out
        spectra = np.fft.rfft(rows)
        spectra[:, -1] = 0
        rows = np.fft.irfft(spectra, 20)
        return rows / np.linalg.norm(rows)

    for q, query in enumerate(queries.astype(float)):
        for p, place in enumerate(places.astype(float)):
            curve = [np.sum(unit(place) * np.roll(unit(query), shift, axis=-1)) for shift in range(20)]
            assert 1 - found.distance[q, p] == pytest.approx(max(curve), abs=0.15)  # refined between the samples
            assert 1 - found.distance[q, p] >= max(curve) - 1e-5
    assert found.distance[1].argmin() == 2
    assert found.rotation_rad[1, 2] == pytest.approx(np.pi / 2, abs=1e-3)


def test_the_distance_refuses_other_shapes():
    index = CircularCorrelation().prepare(TinyImage().describe(PANORAMAS))
    with pytest.raises(DataError, match="describe both with the same settings"):
        CircularCorrelation().match(TinyImage(rows=8).describe(PANORAMAS), index)
    with pytest.raises(DataError, match="no two axes"):
        CircularCorrelation().prepare(Signatures(np.zeros((2, 5), np.float32)))
