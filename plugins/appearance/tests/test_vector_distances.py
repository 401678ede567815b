"""Distances between vectors against scipy, formulas written out, and exact turns of headings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.distance import cdist

from omnilab.api import Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_distance
from omnilab_appearance import Cityblock, Cosine, Euclidean, Log, Pearson, Poc, PocSquared, Root, Weighted

RNG = np.random.default_rng(8)
PLACES, QUERIES = RNG.random((9, 5, 8), np.float32), RNG.random((4, 5, 8), np.float32)
P, Q = PLACES.reshape(9, 40).astype(float), QUERIES.reshape(4, 40).astype(float)
ALL = [Cityblock(), Cosine(), Euclidean(), Log(), Pearson(), Root(), Weighted(), Weighted(2, 0.9), Weighted(4, 1.0)]


def distances(distance, queries=QUERIES, places=PLACES):
    return distance.match(Signatures(queries), distance.prepare(Signatures(places))).distance


@pytest.mark.parametrize("distance", [*ALL, PocSquared()], ids=repr)
def test_the_contract(distance):
    check_distance(distance)


@pytest.mark.parametrize(
    ("distance", "reference"),
    [
        (Cityblock(), cdist(Q, P, "cityblock")),
        (Cosine(), cdist(Q, P, "cosine")),
        (Euclidean(), cdist(Q, P, "euclidean")),
        (Pearson(), cdist(Q, P, "correlation")),
        (Weighted(3, 1.0), cdist(Q, P, "minkowski", p=3)),
        (Weighted(3, 0.95), cdist(Q, P, "minkowski", p=3, w=0.95 ** np.arange(40))),
        (Weighted(2, 0.5), cdist(Q, P, "minkowski", p=2, w=0.5 ** np.arange(40))),
    ],
    ids=repr,
)
def test_distances_are_scipys(distance, reference):
    np.testing.assert_allclose(distances(distance), reference, rtol=2e-5)


def test_the_log_distance_is_equation_12():
    spans = P.max(0) - P.min(0)
    inner = np.minimum(np.mean(np.abs(Q[:, None] - P) / spans, axis=-1), 1 - 1e-6)
    np.testing.assert_allclose(distances(Log()), -np.log10(1 - inner), rtol=1e-4)


def test_the_log_distance_leaves_out_what_never_varies():
    constant = np.concatenate([PLACES, np.full((9, 5, 2), 7, np.float32)], -1)
    queries = np.concatenate([QUERIES, np.full((4, 5, 2), -70, np.float32)], -1)
    np.testing.assert_allclose(distances(Log(), queries, constant), distances(Log()), rtol=1e-5)
    assert distances(Log(), 1000 * QUERIES).max() == pytest.approx(6, abs=0.2)


def test_the_root_distance_is_equation_13():
    expected = np.sqrt(np.mean(((Q[:, None] - P) / (Q[:, None] + P)) ** 2, axis=-1))
    np.testing.assert_allclose(distances(Root()), expected, rtol=1e-4)


def test_squared_poc_is_poc_squared():
    np.testing.assert_allclose(distances(PocSquared()), distances(Poc()) ** 2, rtol=1e-5)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, (3, 6), elements=st.floats(0, 1000, width=32)))
def test_no_distance_is_ever_nan(values):
    for distance in ALL:
        found = distances(distance, values, np.concatenate([values[:1], np.zeros((1, 6), np.float32)]))
        assert np.isfinite(found).all()
        assert (found >= -1e-5).all()


@pytest.mark.parametrize("distance", ALL, ids=repr)
@given(shift=st.floats(-200, 200))
@settings(max_examples=10)
def test_headings_tell_the_rotation(distance, shift):
    """Headings are smooth curves known everywhere, so any angle has its exact answer."""
    turn = np.deg2rad(shift)
    azimuth = 2 * np.pi * np.arange(36) / 36
    phases = np.random.default_rng(2).uniform(0, 2 * np.pi, (4, 3, 5))

    def headings(turned_rad):
        angles = azimuth + turned_rad  # what lies at azimuth a of the world is at a - turn in the picture
        waves = np.cos(np.arange(1, 6)[:, None] * angles + phases[..., None])
        return waves.sum(2).astype(np.float32)

    places = Signatures(PLACES[:4], headings(0.0))
    queries = Signatures(PLACES[:4], headings(turn))
    rotation = distance.match(queries, distance.prepare(places)).rotation_rad
    error = np.angle(np.exp(1j * (rotation.diagonal() - turn)))
    assert np.abs(np.rad2deg(error)).max() < 0.5
    assert (rotation >= -np.pi).all()
    assert (rotation < np.pi).all()


def test_without_headings_there_is_no_rotation():
    index = Euclidean().prepare(Signatures(PLACES))
    assert Euclidean().match(Signatures(QUERIES), index).rotation_rad is None
    flat = Signatures(PLACES, np.ones((9, 8), np.float32))
    assert np.isfinite(Euclidean().match(flat, Euclidean().prepare(flat)).rotation_rad).all()


def test_signatures_of_another_shape_are_refused():
    with pytest.raises(DataError, match=r"\(5, 7\) cannot be compared with places of shape \(5, 8\)"):
        distances(Cosine(), QUERIES[..., :7])


@pytest.mark.parametrize("settings", [{"p": 0}, {"p": 17}, {"decay": 0}, {"decay": 1.1}])
def test_a_weighted_metric_that_is_none(settings):
    with pytest.raises(ConfigError, match="give a"):
        Weighted(**settings)
