"""Scores on maps small enough to check by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from omnilab.metrics import distances_to, heading_error, ranks, sharpness, verdicts

GRID = np.array([[x, y, 1.0] for y in range(3) for x in range(3)])  # place 3 * y + x


def _verdict(x, y, answer):
    return str(verdicts(distances_to(np.array([[x, y, 1.0]]), GRID), np.array([answer]))[0])


def test_the_closest_place_is_nearest_then_second_then_wrong():
    assert _verdict(0.1, 0.2, 0) == "nearest"
    assert _verdict(0.1, 0.2, 3) == "second"  # (0, 1) is 0.806 away, (1, 0) 0.922
    assert _verdict(0.1, 0.2, 1) == "wrong"


def test_all_four_places_around_a_query_half_way_are_nearest():
    assert {_verdict(0.5, 0.5, place) for place in (0, 1, 3, 4)} == {"nearest"}
    assert {_verdict(0.5, 0.5, place) for place in (2, 5, 6, 7)} == {"second"}  # all at the next distance
    assert _verdict(0.5, 0.5, 8) == "wrong"


def test_places_within_a_millimetre_of_the_nearest_count_as_nearest():
    assert _verdict(0.4996, 0.0, 1) == "nearest"
    assert _verdict(0.4990, 0.0, 1) == "second"


def test_ranks_count_the_places_that_come_before_a_nearest_one():
    apart = distances_to(np.array([[0.5, 0.5, 1.0]]), GRID)
    field = np.array([[5, 9, 1, 7, 8, 2, 9, 9, 9.0]])  # the first of places 0, 1, 3, 4 is place 0 with 5
    assert ranks(apart, field)[0] == 3


def test_sharpness_by_hand():
    assert np.allclose(sharpness(np.array([[0.0, 1, 1, 1], [2, 2, 2, 2], [0, 0, 0, 1]])), [0.75, 0, 0.25])


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_heading_errors_do_not_care_about_whole_turns(a, b):
    error = heading_error(np.array([a]), np.array([b]))[0]
    assert 0 <= error <= np.pi + 1e-12
    assert np.isclose(np.cos(error), np.cos(a - b), atol=1e-9)
