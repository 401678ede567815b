"""Localizers on maps whose right answers are known."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Match, Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.testing import check_localizer
from omnilab_appearance import Cosine, Euclidean, Hierarchical, Interpolated, Log, Nearest, PocBand

GRID_M = np.stack([*(a.ravel() for a in np.meshgrid(np.arange(6.0), np.arange(5.0))), np.ones(30)], axis=1)


@dataclass
class Apart:
    """The length of the difference to some power; counts the pairs it compares."""

    power: float = 2.0
    pairs: list[Any] = field(default_factory=list)

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        self.pairs.append(len(queries.place) * len(index))
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1)
        return Match((apart**self.power).astype(np.float32))


@dataclass
class Table:
    """Distances from a table: signatures are its row and column numbers."""

    table: Any

    def prepare(self, places):
        return places.place[:, 0].astype(int)

    def match(self, queries, index):
        return Match(self.table[np.ix_(queries.place[:, 0].astype(int), index)].astype(np.float32))


def _map(values, position_m=GRID_M, heading_rad=0.0):
    values = np.asarray(values, np.float32)
    return Places(Signatures(values), planar_poses(position_m, heading_rad), [str(i) for i in range(len(values))])


def _answer(localizer, places, distance, queries):
    signatures = queries if isinstance(queries, Signatures) else Signatures(np.asarray(queries, np.float32))
    return localizer.locate(signatures, localizer.prepare(places, distance))


@pytest.mark.parametrize("localizer", [Interpolated(), Interpolated(4), Hierarchical(), Hierarchical(1, 1)])
def test_keeps_the_contract(localizer):
    check_localizer(localizer)


# ------------------------------------------------------------------------------------------------- interpolated
@given(st.floats(0, 5), st.floats(0, 4), st.integers(4, 16))
@settings(max_examples=40)
def test_squared_lengths_give_the_position_exactly(x, y, neighbours):
    """Signatures that are positions, any of them: barycentric coordinates."""
    found = _answer(Interpolated(neighbours), _map(GRID_M), Apart(2), [[x, y, 1]])
    np.testing.assert_allclose(found.position_m, [[x, y, 1]], atol=2e-4)
    assert np.linalg.norm(GRID_M[found.place[0]] - [x, y, 1]) <= np.sqrt(0.5) + 1e-5


def test_equals_the_closest_point_of_the_neighbours_flat():
    """The weights that sum to 1 and rebuild the query's signature best, by least squares on the signatures themselves."""
    rng = np.random.default_rng(2)
    position_m = rng.uniform(-1, 1, (4, 3))
    values, query = rng.standard_normal((4, 9)), rng.standard_normal(9) * 0.1
    free, *_ = np.linalg.lstsq((values[1:] - values[0]).T, query + values.mean(axis=0) - values[0], rcond=None)
    expected = np.append(1 - free.sum(), free) @ position_m
    found = _answer(Interpolated(4), _map(values, position_m), Apart(2), [query + values.mean(axis=0)])
    np.testing.assert_allclose(found.position_m[0], expected, atol=1e-5)


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(1, 30))
@settings(max_examples=60)
def test_stays_finite_and_near_the_nearest_place_whatever_the_distances(seed, neighbours, count):
    """Distances that are no metric, some of them equal, not even symmetric."""
    table = np.random.default_rng(seed).integers(0, 4, (count + 1, count + 1)) / 3
    places = _map(np.arange(count)[:, None], GRID_M[:count])
    found = _answer(Interpolated(neighbours), places, Table(table), [[count]])
    nearest = _answer(Nearest(), places, Table(table), [[count]])
    assert found.place[0] == nearest.place[0]
    assert found.distance[0] == nearest.distance[0]
    reach = np.sort(np.linalg.norm(GRID_M[:count] - nearest.position_m, axis=1))[: min(neighbours, count)][-1]
    assert np.linalg.norm(found.position_m - nearest.position_m) <= reach * (1 + 1e-9)


def test_beats_the_nearest_place_under_saturating_distances():
    """Lengths to the power of 0.7 bend as image distances do; places of random heights and no grid."""
    rng = np.random.default_rng(4)
    position_m = rng.uniform(0, 4, (200, 3)) * [1, 1, 0.2]
    truth_m = rng.uniform(0.5, 3.5, (100, 3)) * [1, 1, 0.2]
    median = [
        np.median(np.linalg.norm(_answer(one, _map(position_m, position_m), Apart(0.7), truth_m).position_m - truth_m, axis=1))
        for one in (Nearest(), Interpolated())
    ]  # fmt: skip
    assert median[1] < 0.5 * median[0]


def test_equal_distances_give_the_centroid_and_one_position_itself():
    places = _map(np.zeros((9, 1)), GRID_M[:9])
    np.testing.assert_allclose(_answer(Interpolated(), places, Apart(), [[0]]).position_m[0], GRID_M[:9].mean(axis=0))
    places = _map(np.arange(9)[:, None], np.tile([[1.0, 2.0, 3.0]], (9, 1)))
    np.testing.assert_allclose(_answer(Interpolated(), places, Apart(), [[3.4]]).position_m, [[1, 2, 3]])
    alone = _answer(Interpolated(), _map([[5.0]], GRID_M[7:8]), Apart(), [[1.0]])
    np.testing.assert_array_equal(alone.position_m, GRID_M[7:8])


def test_headings_are_those_of_the_nearest_place():
    values = np.random.default_rng(0).standard_normal((30, 8, 36)).astype(np.float32)
    places, queries = _map(values, heading_rad=0.3), Signatures(np.roll(values[:6], -9, axis=2))
    found, nearest = (_answer(one, places, PocBand(), queries) for one in (Interpolated(), Nearest()))
    np.testing.assert_allclose(found.heading_rad, 0.3 + np.pi / 2, atol=1e-3)
    np.testing.assert_array_equal(found.heading_rad, nearest.heading_rad)
    np.testing.assert_array_equal(found.field, nearest.field)


# ------------------------------------------------------------------------------------------------- hierarchical
@pytest.mark.parametrize("distance", [Cosine(), Euclidean(), PocBand()])
@pytest.mark.parametrize("with_heading", [False, True])
def test_all_clusters_give_the_answer_of_exhaustive_search(distance, with_heading):
    rng = np.random.default_rng(1)
    values = rng.standard_normal((60, 8, 36)).astype(np.float32)
    heading = rng.standard_normal((60, 2, 36)).astype(np.float32) if with_heading else None
    T = planar_poses(rng.uniform(-1, 1, (60, 3)), rng.uniform(-3, 3, 60))
    places = Places(Signatures(values, heading), T, [""] * 60)
    noisy = values[::4] + 0.4 * rng.standard_normal((15, 8, 36)).astype(np.float32)
    queries = Signatures(noisy, None if heading is None else np.roll(heading[::4], 5, axis=2))
    found = _answer(Hierarchical(clusters=10, probes=10), places, distance, queries)
    exact = _answer(Nearest(), places, distance, queries)
    np.testing.assert_array_equal(found.place, exact.place)
    np.testing.assert_array_equal(found.position_m, exact.position_m)
    np.testing.assert_allclose(found.distance, exact.distance, rtol=1e-5, atol=1e-5)  # products of other shapes
    if exact.heading_rad is None:
        assert found.heading_rad is None
    else:
        np.testing.assert_allclose(np.sin(found.heading_rad - exact.heading_rad), 0, atol=1e-4)
    assert found.field is None


def test_compares_few_places_and_still_finds_the_nearest():
    rng = np.random.default_rng(3)
    position_m = rng.uniform(0, 10, (4000, 3)) * [1, 1, 0]
    truth_m = rng.uniform(0, 10, (200, 3)) * [1, 1, 0]
    localizer, distance = Hierarchical(probes=4), Apart(1)
    index = localizer.prepare(_map(position_m, position_m), distance)
    distance.pairs.clear()
    found = localizer.locate(Signatures(truth_m.astype(np.float32)), index)
    exact = np.linalg.norm(truth_m[:, None] - position_m, axis=-1).argmin(axis=1)
    assert np.mean(found.place == exact) >= 0.99
    compared = sum(distance.pairs) / 200
    assert 126 < compared < 126 + 2 * 4 * 4000 / 126 + 1  # all representatives, four clusters, the answer once more


def test_every_place_is_in_the_cluster_of_its_most_alike_representative():
    rng = np.random.default_rng(5)
    position_m = rng.uniform(0, 10, (500, 3))
    index = Hierarchical(clusters=20).prepare(_map(position_m, position_m), Apart(1))
    assert sorted(np.concatenate(index.members)) == list(range(500))
    away = np.linalg.norm(position_m[:, None] - index.head, axis=-1)
    for cluster, members in enumerate(index.members):
        np.testing.assert_array_equal(away[members].argmin(axis=1), cluster)


def test_the_seed_alone_decides_on_the_representatives():
    places = _map(np.random.default_rng(0).standard_normal((30, 3)))
    heads = [Hierarchical(seed=seed).prepare(places, Apart()).head for seed in (0, 0, 1)]
    np.testing.assert_array_equal(heads[0], heads[1])
    assert not np.array_equal(heads[0], heads[2])


def test_kept_clusters_answer_alike_without_being_found_again(tmp_path):
    rng = np.random.default_rng(4)
    places, queries = _map(rng.standard_normal((300, 3)), rng.uniform(0, 9, (300, 3))), rng.standard_normal((9, 3))
    file = tmp_path / "new" / "clusters.npz"
    first, distance = _answer(Hierarchical(keep=str(file)), places, Apart(), queries), Apart()
    index = Hierarchical(keep=str(file)).prepare(places, distance)
    assert sum(distance.pairs) < 300 * 35  # the check of scales alone, where finding them compares every place with 35
    found = Hierarchical().locate(Signatures(queries.astype(np.float32)), index)
    np.testing.assert_array_equal(found.place, first.place)
    np.testing.assert_array_equal(found.distance, _answer(Hierarchical(), places, Apart(), queries).distance)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"seed": 1}, "another map, distance, seed or number"),
        ({"clusters": 9}, "another map, distance, seed or number"),
    ],
)
def test_clusters_of_other_settings_are_refused_and_left_alone(tmp_path, change, reason):
    places, file = _map(GRID_M), tmp_path / "clusters.npz"
    Hierarchical(keep=str(file)).prepare(places, Apart())
    before = file.read_bytes()
    for localizer, distance, others in (
        (Hierarchical(keep=str(file), **change), Apart(), places), (Hierarchical(keep=str(file)), Apart(1), places),
        (Hierarchical(keep=str(file)), Apart(), _map(GRID_M + 1)),
    ):  # fmt: skip
        with pytest.raises(DataError, match=reason):
            localizer.prepare(others, distance)
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"no archive", "no whole archive"), ({"about": np.array("x"), "owner": np.zeros(30, np.int32)}, "it says no"),
        ({"owner": np.full(30, 11, np.int32)}, "one of 11 clusters"), ({"owner": np.zeros(29, np.int32)}, "one of 11"),
        ({}, "one of 11"),
    ],
)  # fmt: skip
def test_files_that_hold_no_clusters_are_refused(tmp_path, content, reason):
    file = tmp_path / "clusters.npz"
    Hierarchical(keep=str(file)).prepare(_map(GRID_M), Apart())
    with np.load(file) as kept:
        about = kept["about"]
    file.write_bytes(content) if isinstance(content, bytes) else np.savez(file, **{"about": about} | content)
    with pytest.raises(DataError, match=reason):
        Hierarchical(keep=str(file)).prepare(_map(GRID_M), Apart())


def test_equal_distances_and_duplicates_are_answered():
    found = _answer(Hierarchical(), _map(np.zeros((30, 2))), Apart(), [[0, 0], [1, 1]])
    assert np.isfinite(found.position_m).all()
    twice = _map(np.repeat(GRID_M[:15], 2, axis=0), np.repeat(GRID_M[:15], 2, axis=0))
    found = _answer(Hierarchical(), twice, Apart(), GRID_M[:15])
    np.testing.assert_array_equal(found.position_m, GRID_M[:15])


def test_a_distance_that_learns_from_the_map_is_refused():
    values = np.random.default_rng(0).uniform(0, 9, (200, 6))
    with pytest.raises(DataError, match="learns its scale from the whole map"):
        Hierarchical().prepare(_map(values, np.zeros((200, 3))), Log())


# ------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize("localizer", [Interpolated(), Hierarchical()])
def test_a_map_without_places_or_positions_is_refused(localizer):
    empty = Signatures(np.zeros((0, 4, 4), np.float32))
    with pytest.raises(DataError, match="no places"):
        localizer.prepare(Places(empty, np.zeros((0, 4, 4)), []), PocBand())
    one = Signatures(np.zeros((1, 4, 4), np.float32))
    name = type(localizer).__name__.lower()
    with pytest.raises(DataError, match=f"localizer={name} needs a map with positions"):
        localizer.prepare(Places(one, None, ["a"]), PocBand())


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="neighbours=1 is out of range; give a whole number from 2 to 10000"):
        Interpolated(1)
    with pytest.raises(ConfigError, match="clusters=0 is out of range; give a whole number of 1 or more, or null"):
        Hierarchical(clusters=0)
    with pytest.raises(ConfigError, match="probes=0 is out of range"):
        Hierarchical(probes=0)
    with pytest.raises(DataError, match="clusters=31 are more than the map's 30 places"):
        Hierarchical(clusters=31).prepare(_map(GRID_M), Apart())
