"""Normalised gradients, gist and phases against scikit-image, numpy, and what gains and covers may change."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from skimage.feature import hog

from omnilab.api import Signatures
from omnilab.errors import DataError
from omnilab.testing import check_distance
from omnilab.testing.common import smooth_images
from omnilab_appearance import CircularCorrelation, FourierPhase, GistGrid, Hog, HogGrid, TinyImage
from omnilab_appearance.common.block_norm import BlockNorm

RNG = np.random.default_rng(9)
PANORAMAS = RNG.integers(20, 200, (2, 128, 512), dtype=np.uint8)
OF_SCIKIT = {BlockNorm.l1: "L1", BlockNorm.l1_sqrt: "L1-sqrt", BlockNorm.l2: "L2", BlockNorm.l2_hys: "L2-Hys"}
GRIDS = [HogGrid(floor=0), GistGrid(floor=0), FourierPhase()]


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
