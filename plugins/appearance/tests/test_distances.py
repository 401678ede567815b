"""Distances against scipy, scikit-image and exact shifts."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, rotate
from scipy.spatial.distance import cdist
from skimage.registration import phase_cross_correlation

from omnilab.api import Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_distance, check_localizer
from omnilab_appearance import Euclidean, Nearest, Poc, PocBand, Radon
from omnilab_appearance.common.circular_correlation import vertex
from omnilab_appearance.distances.poc import between


@pytest.mark.parametrize("distance", [Poc(), PocBand(), PocBand(6.0, 5.0), Euclidean()])
def test_keeps_the_contract(distance):
    check_distance(distance)


def test_nearest_keeps_the_contract():
    check_localizer(Nearest())


def _matrices(count, seed=0, shape=(20, 30)):
    return np.random.default_rng(seed).standard_normal((count, *shape)).astype(np.float32)


def test_poc_equals_the_printed_equations():
    places, query = _matrices(3), _matrices(1, seed=1)
    match = Poc().match(Signatures(query), Poc().prepare(Signatures(places)))
    for p in range(3):
        cross = np.fft.fft2(places[p].astype(float)) * np.conj(np.fft.fft2(query[0].astype(float)))
        correlation = np.fft.ifft2(cross / np.abs(cross)).real  # eq. 2.12-2.13
        assert np.isclose(match.distance[0, p], 1 - correlation.max(), atol=1e-5)  # eq. 4.2


@given(st.integers(1, 23), st.integers(1, 23), st.integers(1, 9), st.integers(0, 2**31))
@settings(max_examples=30)
def test_poc_chooses_the_sample_that_an_fft_of_the_whole_surface_chooses(rows, columns, count, seed):
    places = _matrices(count, seed, (rows, columns))
    query = np.roll(places[:1], 1, axis=2) + 0.5 * _matrices(1, seed + 1, (rows, columns))
    match = Poc().match(Signatures(query), Poc().prepare(Signatures(places)))
    spectra = [np.fft.rfft2(m.astype(float)) for m in (places, query)]
    phases = [s / np.maximum(np.abs(s), 1e-300) for s in spectra]
    surfaces = np.fft.irfft2(phases[0] * phases[1].conj(), s=(rows, columns))
    row, column = np.divmod(surfaces.reshape(count, -1).argmax(axis=1), columns)
    peak, before, after = (surfaces[np.arange(count), row, (column + shift) % columns] for shift in (0, -1, 1))
    np.testing.assert_allclose(match.distance[0], 1 - peak, atol=1e-5)
    shift = (match.rotation_rad[0] * columns / (2 * np.pi) - column - between(before, peak, after)) / columns
    single = (
        np.sort(surfaces.reshape(count, -1))[:, -2:] @ [-1, 1] > 1e-5 if rows * columns > 1 else np.zeros(count, bool)
    )
    np.testing.assert_allclose((shift - np.round(shift))[single], 0, atol=1e-3)


@given(st.integers(0, 29), st.integers(0, 19))
@settings(max_examples=20)
def test_poc_finds_the_shift_that_scikit_image_finds(columns, rows):
    place = _matrices(1)
    query = np.roll(place, (rows, -columns), axis=(1, 2))
    match = Poc().match(Signatures(query), Poc().prepare(Signatures(place)))
    expected = phase_cross_correlation(place[0], query[0])[0][1]  # columns that register the query to the place
    error = match.rotation_rad[0, 0] - 2 * np.pi * expected / 30
    assert abs(np.angle(np.exp(1j * error))) < 1e-3
    assert match.distance[0, 0] < 1e-5


@cache
def _scene(side=251):
    """A picture with detail of every size, as the world has."""
    rng = np.random.default_rng(3)
    layers = [s * gaussian_filter(rng.standard_normal((side, side)), s) for s in (1, 2, 4, 8, 16, 32)]
    return np.clip(127 + 40 * np.sum(layers, axis=0) / np.std(layers[0]) / 3, 0, 255)


@given(st.floats(-180, 180))
@settings(max_examples=25)
@pytest.mark.parametrize("distance", [Poc(), PocBand()])
def test_the_turn_of_an_image_is_found_between_the_samples(distance, turn_deg):
    image = _scene()
    turned = rotate(image, -turn_deg, reshape=False, order=3, mode="nearest")  # the camera turned to the left
    pictures = np.clip(np.stack([image, turned]), 0, 255).astype(np.uint8)
    signatures = Radon().describe(pictures)
    match = distance.match(signatures[1:], distance.prepare(signatures[:1]))
    error = np.rad2deg(match.rotation_rad[0, 0]) - turn_deg
    assert abs((error + 180) % 360 - 180) < 0.5


def test_the_band_equals_its_definition():
    places, query = _matrices(3), _matrices(1, seed=1)
    method = PocBand(angle_band=3.0, offset_band=2.0)
    match = method.match(Signatures(query), method.prepare(Signatures(places)))
    j, k = np.fft.fftfreq(20, 1 / 20)[:, None], np.fft.fftfreq(30, 1 / 30)[None, :]
    weight = np.exp(-0.5 * (j / 2) ** 2 - 0.5 * (k / 3) ** 2) * (np.abs(j) <= 5) * (np.abs(k) <= 7.5)
    for p in range(3):
        phase = np.angle(np.fft.fft2(query[0])) - np.angle(np.fft.fft2(places[p]))
        turns = np.linspace(0, 2 * np.pi, 3600, endpoint=False)
        similar = [np.sum(weight * np.cos(phase - k * turn)) / weight.sum() for turn in turns]
        assert np.isclose(match.distance[0, p], 1 - np.max(similar), atol=5e-3)
        assert abs(np.angle(np.exp(1j * (match.rotation_rad[0, p] - turns[np.argmax(similar)])))) < 0.2 * 2 * np.pi / 30


def test_euclidean_equals_scipy():
    queries, places = _matrices(4, seed=1), _matrices(6)
    match = Euclidean().match(Signatures(queries), Euclidean().prepare(Signatures(places)))
    assert np.allclose(match.distance, cdist(queries.reshape(4, -1), places.reshape(6, -1)), rtol=1e-4)
    assert match.rotation_rad is None


@given(st.floats(-0.49, 0.49), st.floats(0.1, 10))
def test_the_vertex_of_a_parabola_is_found(offset, bend):
    before, peak, after = (np.array([-bend * (x - offset) ** 2]) for x in (-1, 0, 1))
    assert np.isclose(vertex(before, peak, after)[0], offset, atol=1e-6)


@given(st.floats(-0.49, 0.49))
def test_the_peak_of_a_sinc_is_found_between_its_samples(offset):
    before, peak, after = (np.array([np.sinc(x - offset)]) for x in (-1, 0, 1))
    assert np.isclose(between(before, peak, after)[0], offset, atol=1e-6)


def test_a_flat_curve_has_its_vertex_in_the_middle():
    assert vertex(np.ones(1), np.ones(1), np.ones(1))[0] == 0


def test_signatures_without_two_axes_are_refused():
    with pytest.raises(DataError, match="euclidean"):
        Poc().prepare(Signatures(np.zeros((3, 9), np.float32)))
    with pytest.raises(DataError, match="euclidean"):
        PocBand().prepare(Signatures(np.zeros((3, 9), np.float32)))
    with pytest.raises(ConfigError, match="angle_band=0 is out of range; give a number above 0"):
        PocBand(0, 40)


def test_a_map_without_places_or_positions_is_refused():
    empty = Signatures(np.zeros((0, 4, 4), np.float32))
    with pytest.raises(DataError, match="no places"):
        Nearest().prepare(Places(empty, np.zeros((0, 4, 4)), []), Poc())
    one = Signatures(np.zeros((1, 4, 4), np.float32))
    with pytest.raises(DataError, match="positions"):
        Nearest().prepare(Places(one, None, ["a"]), Poc())
