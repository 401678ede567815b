"""The filter on maps whose answers are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Match, Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.testing import check_localizer
from omnilab_appearance import BayesFilter

LINE = planar_poses(np.column_stack([np.arange(12.0), np.zeros(12), np.ones(12)]))


@dataclass
class Given:
    """Queries are their own distances to the places; the camera always looks along the places' heading."""

    rotation: float = 0.0

    def prepare(self, places):
        return len(places)

    def match(self, queries, index):
        return Match(queries.place, np.full((len(queries), index), self.rotation, np.float32))


def line(count=12):
    return Places(Signatures(np.zeros((count, 1), np.float32)), LINE[:count], [str(i) for i in range(count)])


def seen(*alike):
    """One query a row: 0 where it looks like the places named, 1 elsewhere."""
    distance = np.ones((len(alike), 12), np.float32)
    for row, places in zip(distance, alike, strict=True):
        row[list(places)] = 0
    return Signatures(distance)


def test_keeps_the_contract():
    check_localizer(BayesFilter())


def test_two_places_alike_are_distinguished_by_what_came_before():
    follow = BayesFilter()
    found = follow.locate(seen([2], [3, 9], [4, 10]), follow.prepare(line(), Given()))
    assert found.place.tolist() == [2, 3, 4]
    alone = follow.locate(seen([3, 9]), follow.prepare(line(), Given()))
    assert alone.field[0, 3] == pytest.approx(alone.field[0, 9])  # without a past either is as likely


def test_odometry_tells_which_way_it_went():
    follow = BayesFilter(motion_m=0.3)
    for forward, expected in ((2.0, 7), (-2.0, 3)):
        index = follow.prepare(line(), Given())
        found = follow.track(seen([5], [3, 7]), index, np.array([[np.nan] * 3, [forward, 0.0, 0.0]]))
        assert found.place.tolist() == [5, expected]


def test_odometry_is_in_the_frame_of_the_camera():
    follow = BayesFilter(motion_m=0.3)
    index = follow.prepare(line(), Given(rotation=np.pi / 2))  # the camera looks along +y: its right is +x
    found = follow.track(seen([5], [3, 7]), index, np.array([[np.nan] * 3, [0.0, -2.0, 0.0]]))
    assert found.place.tolist() == [5, 7]
    assert np.allclose(found.heading_rad, np.pi / 2)


def test_one_that_was_carried_away_is_found_again():
    follow = BayesFilter()
    found = follow.locate(seen([0], [1], [10], [11]), follow.prepare(line(), Given()))
    assert found.place.tolist()[-1] == 11


def test_beliefs_sum_to_one_and_follow_bayes():
    follow = BayesFilter(motion_m=1.0, lost=0.1, certainty=2.0)
    index = follow.prepare(line(), Given())
    found = follow.locate(seen([4], [6]), index)
    apart = np.abs(np.subtract.outer(np.arange(12), np.arange(12)))
    moved = np.exp(-0.5 * apart**2)
    first = np.exp(-2.0 * (np.arange(12) != 4))
    first /= first.sum()
    second = (0.9 * first @ (moved / moved.sum(axis=1, keepdims=True)) + 0.1 / 12) * np.exp(-2.0 * (np.arange(12) != 6))
    assert np.allclose(np.exp(-found.field), [first, second / second.sum()], rtol=1e-5)


def test_places_that_are_all_alike_say_nothing():
    follow = BayesFilter()
    index = follow.prepare(line(), Given())
    follow.locate(seen([4]), index)
    found = follow.locate(seen(range(12)), index)
    assert found.place[0] == 4
    assert np.isfinite(found.field).all()


@pytest.mark.parametrize("settings", [{"motion_m": 0.0}, {"certainty": 0.0}, {"lost": 0.0}, {"lost": 1.0}])
def test_settings_that_follow_nothing_are_refused(settings):
    with pytest.raises(ConfigError, match="is out of range; give a number above 0"):
        BayesFilter(**settings)


def test_a_map_of_one_place_has_no_step():
    with pytest.raises(DataError, match="motion_m"):
        BayesFilter().prepare(line(1), Given())
