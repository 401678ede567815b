"""Localizers of sequences along a route, on maps whose answers are known."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Match, Places, SequenceLocalizer, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.testing import check_localizer
from omnilab_appearance import BayesFilter, RouteFilter, SequenceMatching

COUNT = 40
ROUTE = planar_poses(np.column_stack([0.1 * np.arange(COUNT), np.zeros(COUNT), np.ones(COUNT)]))


@dataclass
class Given:
    """Queries are their own distances to the places."""

    def prepare(self, places):
        return len(places)

    def match(self, queries, index):
        return Match(queries.place, np.full((len(queries), index), 0.5, np.float32))


def route(count=COUNT):
    return Places(Signatures(np.zeros((count, 1), np.float32)), ROUTE[:count], [str(i) for i in range(count)])


def seen_from(x_m, reach_m=1.0):
    """Queries at positions along the route, whose distances grow with metres and saturate."""
    away = np.abs(np.subtract.outer(np.asarray(x_m), ROUTE[:, 0, 3]))
    return Signatures(np.minimum(away, reach_m).astype(np.float32))


def answers(localizer, queries, motion=None):
    index = localizer.prepare(route(), Given())
    motion = np.full((len(queries), 3), np.nan) if motion is None else motion
    return localizer.track(queries, index, motion)


@pytest.mark.parametrize("localizer", [RouteFilter(), SequenceMatching(), SequenceMatching(window=None, length=3)])
def test_keep_the_contract(localizer):
    check_localizer(localizer)
    assert isinstance(localizer, SequenceLocalizer)


def test_the_speed_is_part_of_the_state():
    """A camera that moves two and a half steps a query is followed, and by a filter without a speed never reached."""
    x_m = 0.1 + 0.25 * np.arange(14)
    followed, behind = (
        answers(RouteFilter(certainty=6), seen_from(x_m)),
        answers(BayesFilter(certainty=6), seen_from(x_m)),
    )
    np.testing.assert_allclose(followed.position_m[3:, 0], x_m[3:], atol=0.02)
    assert (behind.position_m[3:, 0] < x_m[3:] - 0.05).all()


@given(st.floats(-0.35, 0.35), st.floats(0.0, 0.1))
def test_positions_lie_between_places(speed_m, offset_m):
    start = 3.6 if speed_m < 0 else 0.2
    x_m = start + offset_m + speed_m * np.arange(8)
    found = answers(RouteFilter(), seen_from(x_m))
    np.testing.assert_allclose(found.position_m[2:, 0], x_m[2:], atol=0.05)
    np.testing.assert_allclose(found.heading_rad, 0.5)


def test_odometry_gives_the_speed():
    """What looks the same everywhere is told by the odometry alone."""
    x_m = np.array([0.5, 0.7, 0.9, 1.1])
    queries = seen_from(x_m)
    queries.place[1:] = 1.0
    motion = np.array([[np.nan] * 3, *[[0.2, 0.0, 0.0]] * 3])
    found = answers(RouteFilter(acceleration=0.1, lost=1e-6), queries, motion)
    assert (
        np.abs(np.abs(found.position_m[:, 0] - 0.5) - (x_m - 0.5)).max() < 0.06
    )  # either way: it had no direction yet


def test_beliefs_are_those_of_the_forward_algorithm():
    """Against the recursion spelled out, cell by cell."""
    own = RouteFilter(fastest=0.5, acceleration=0.5, certainty=3.0, lost=0.1)
    queries = seen_from([0.2, 0.25])
    places = Places(Signatures(np.zeros((4, 1), np.float32)), ROUTE[:4], list("abcd"))
    queries = Signatures(queries.place[:, :4])
    index = own.prepare(places, Given())
    own.locate(queries, index)
    cells, speeds = np.arange(13) * 0.025, np.arange(-2, 3)
    belief = np.full((13, 5), 1 / 65)
    for q, distance in enumerate(queries.place.astype(float)):
        if q:
            moved = np.zeros((13, 5))
            for c in range(13):
                for v in range(5):
                    to = np.exp(-0.5 * ((speeds[v] - speeds) / 2.0) ** 2)
                    for w, share in enumerate(to / to.sum()):
                        if 0 <= c + speeds[w] < 13:
                            moved[c + speeds[w], w] += belief[c, v] * share
            belief = 0.9 * moved / moved.sum() + 0.1 / 65
        above = distance - distance.min()
        belief = belief * np.exp(np.interp(cells, 0.1 * np.arange(4), -3 * above / np.median(above)))[:, None]
        belief /= belief.sum()
    np.testing.assert_allclose(index.belief, belief, rtol=1e-9)


def test_alike_stretches_are_told_apart_by_the_sequence():
    """Places 5 to 9 and 25 to 29 look the same; what came before tells which they are."""
    x = np.arange(18, 30)
    look = np.arange(COUNT) % 1000
    look[5:10] = look[25:30]
    queries = Signatures((look[x][:, None] != look[None, :]).astype(np.float32))
    assert queries.place[-1].argmin() == 9  # alone, the first of the two
    found = answers(SequenceMatching(window=None), queries)
    assert found.place[6:].tolist() == x[6:].tolist()
    assert answers(RouteFilter(), queries).place[6:].tolist() == x[6:].tolist()


def test_scores_are_those_of_all_lines():
    """Against the sums of the paper, line by line."""
    own = SequenceMatching(length=4, window=7, slowest=0.5, fastest=1.5, speed_step=0.25)
    difference = np.random.default_rng(3).random((6, COUNT)).astype(np.float32)
    found = answers(own, Signatures(difference)).field[-1]
    contrast = np.empty((6, COUNT))
    for q in range(6):
        for p in range(COUNT):
            low = min(max(p - 3, 0), COUNT - 7)
            around = difference[q, low : low + 7].astype(float)
            contrast[q, p] = (difference[q, p] - around.mean()) / around.std()
    for p in range(COUNT):
        sums = []
        for speed in (0.5, 0.75, 1.0, 1.25, 1.5):
            at = [p - int(np.round(speed * k)) for k in range(4)]
            sums.append(np.mean([contrast[5 - k, a] if a >= 0 else contrast[5 - k].max() for k, a in enumerate(at)]))
        assert found[p] == pytest.approx(min(sums), rel=1e-5)


@pytest.mark.parametrize("localizer", [RouteFilter(), SequenceMatching(length=3)])
def test_batches_are_one_sequence(localizer):
    queries = Signatures(np.random.default_rng(3).random((9, COUNT)).astype(np.float32))
    index = localizer.prepare(route(), Given())
    parts = [localizer.locate(queries[some], index) for some in (slice(0, 2), slice(2, 3), slice(3, 9))]
    np.testing.assert_array_equal(np.concatenate([part.field for part in parts]), answers(localizer, queries).field)


def test_a_route_that_is_none_is_a_sentence():
    standing = Places(Signatures(np.zeros((3, 1), np.float32)), ROUTE[[0, 0, 0]], list("abc"))
    with pytest.raises(DataError, match="3 places are at one position, which is no route; give places apart"):
        RouteFilter().prepare(standing, Given())
    with pytest.raises(ConfigError, match="slowest=2 is above fastest=1; give a smaller slowest"):
        SequenceMatching(slowest=2, fastest=1)


@pytest.mark.parametrize("localizer", [RouteFilter(), SequenceMatching()])
def test_queries_that_tell_nothing_have_an_answer(localizer):
    found = answers(localizer, Signatures(np.ones((3, COUNT), np.float32)))
    assert np.isfinite(found.field).all()
    assert np.isfinite(found.position_m).all()
