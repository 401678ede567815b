"""Scores on maps small enough to check by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab import metrics
from omnilab.metrics import (
    average_precision,
    bootstrap,
    distances_to,
    first_ranks,
    heading_error,
    is_flat,
    middle,
    precision_recall,
    ranks,
    recall_at,
    recall_at_full_precision,
    resampled_curves,
    sharpness,
    spacing,
    tie_distance,
    verdicts,
)

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


def test_places_within_a_millimetre_of_the_nearest_count_or_theseest():
    assert _verdict(0.4996, 0.0, 1) == "nearest"
    assert _verdict(0.4990, 0.0, 1) == "second"


def test_ranks_count_the_places_that_come_before_a_nearest_one():
    apart = distances_to(np.array([[0.5, 0.5, 1.0]]), GRID)
    field = np.array([[5, 9, 1, 7, 8, 2, 9, 9, 9.0]])  # the first of places 0, 1, 3, 4 is place 0 with 5
    assert ranks(apart, field)[0] == 3


def test_a_nearest_place_comes_last_where_all_are_as_far():
    apart = distances_to(np.array([[0.1, 0.1, 1.0]]), GRID)
    assert ranks(apart, np.ones((1, 9)))[0] == 9
    assert ranks(apart, np.full((1, 9), np.nan))[0] == 9
    assert ranks(apart, np.array([[np.nan, 1, 1, 1, 1, 1, 1, 1, 1]]))[0] == 9
    assert ranks(apart, np.array([[1.0, 1, 2, 2, 2, 2, 2, 2, 2]]))[0] == 1


def test_an_answer_by_chance_is_scored_as_the_worst_it_could_have_been():
    apart = distances_to(np.array([[0.1, 0.0, 1.0]] * 3), GRID)
    or_these = np.zeros((3, 9), bool)
    or_these[0, [0, 1]] = or_these[1, [0, 8]] = or_these[2, 0] = True
    assert verdicts(apart, np.zeros(3, int), or_these=or_these).tolist() == ["second", "wrong", "nearest"]


def test_distances_are_flat_that_differ_by_rounding_alone():
    field = np.array([[1, 1, 2], [1, 1.1, 2], [0, 0, 0], [5, 5.000001, 5], [1e-9, 2e-9, 3e-9]])
    assert is_flat(field).tolist() == [False, False, True, True, False]


def test_ties_follow_the_spacing_and_are_a_millimetre_in_rooms():
    assert {tie_distance(s) for s in (0.05, 0.1, 0.2, 0.4, 1.0, 2.0)} == {1e-3}
    assert tie_distance(0.005) == pytest.approx(1e-4)
    assert tie_distance(20.0) == pytest.approx(1e-2)
    assert tie_distance(np.nan) == 1e-3
    apart = distances_to(np.array([[0.496, 0.0, 1.0]]), GRID)
    assert verdicts(apart, np.array([1])).tolist() == ["second"]
    assert verdicts(apart, np.array([1]), tie_m=0.01).tolist() == ["nearest"]


def test_sharpness_by_hand():
    assert np.allclose(sharpness(np.array([[0.0, 1, 1, 1], [2, 2, 2, 2], [0, 0, 0, 1]])), [0.75, 0, 0.25])


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_heading_errors_do_not_care_about_whole_turns(a, b):
    error = heading_error(np.array([a]), np.array([b]))[0]
    assert 0 <= error <= np.pi + 1e-12
    assert np.isclose(np.cos(error), np.cos(a - b), atol=1e-9)


def test_spacing_is_the_step_of_a_grid():
    assert spacing(0.2 * GRID) == pytest.approx(0.2)
    assert np.isnan(spacing(GRID[:1]))
    assert np.isnan(spacing(GRID[[4, 4, 4]]))  # one place
    assert spacing(np.concatenate([GRID, GRID])) == 1  # two pictures of each
    x, y = np.meshgrid(np.arange(60), np.arange(40))
    assert spacing(0.3 * np.column_stack([x.ravel(), y.ravel(), np.zeros(2400)])) == pytest.approx(0.3)


def test_the_first_true_place_comes_after_all_that_are_as_far():
    field = np.array([[3.0, 1, 2, 2], [1, 1, 1, 1], [0, 1, 2, 3]])
    true = np.array([[False, False, True, False], [False, True, False, False], [False] * 4])
    assert first_ranks(field, true).tolist() == [3, 4, 0]  # a constant field finds its place last
    assert first_ranks(field * np.nan, true).tolist() == [4, 4, 0]  # and so does none at all


def test_recall_leaves_out_queries_without_a_true_place():
    ranks = np.array([1, 2, 0, 6, 0])
    assert recall_at(ranks, 1) == pytest.approx(1 / 3)
    assert recall_at(ranks, 5) == pytest.approx(2 / 3)
    assert np.isnan(recall_at(np.zeros(2, int), 1))


def test_precision_and_recall_by_hand():
    distance = np.array([0.1, 0.2, 0.2, 0.4, 0.5])
    correct = np.array([True, False, True, True, False])
    known = np.array([True, True, True, True, False])  # the last query has no true place: only precision suffers
    precision, recall, threshold = precision_recall(distance, correct, known)
    assert threshold.tolist() == [0.1, 0.2, 0.4, 0.5]
    assert np.allclose(precision, [1, 2 / 3, 3 / 4, 3 / 5])
    assert np.allclose(recall, [1 / 4, 2 / 4, 3 / 4, 3 / 4])
    assert recall_at_full_precision(precision, recall) == 0.25
    assert average_precision(precision, recall) == pytest.approx(1 / 4 + 2 / 3 / 4 + 3 / 4 / 4)


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=40))
def test_precision_and_recall_as_scikit_learn_has_them(answers):
    sklearn = pytest.importorskip("sklearn.metrics", reason="scikit-learn is not installed")
    distance, correct = np.array([d for d, _ in answers], float), np.array([c for _, c in answers])
    if not correct.any():
        return
    found = average_precision(*precision_recall(distance, correct, correct)[:2])
    assert found == pytest.approx(sklearn.average_precision_score(correct, -distance))


def test_a_bootstrap_interval_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        values = rng.normal(size=60)
        low, high = bootstrap(lambda chosen, values=values: float(values[chosen].mean()), 60, rng, resamples=200)
        covered += low <= 0 <= high
    assert 180 <= covered <= 198  # 95 %, within three standard errors, and a little less for 60 samples


def test_a_bootstrap_skips_resamples_that_say_nothing():
    values = np.array([np.nan, 1.0])
    statistic = lambda chosen: float(np.nanmax(values[chosen])) if np.isfinite(values[chosen]).any() else np.nan
    assert bootstrap(statistic, 2, np.random.default_rng(1), resamples=50) == (1.0, 1.0)
    low, high = bootstrap(lambda _: float("nan"), 2, np.random.default_rng(1), resamples=5)
    assert np.isnan(low)
    assert np.isnan(high)


def test_answers_at_no_finite_distance_are_never_accepted():
    distance = np.array([0.5, np.nan, 0.2, np.inf])
    correct, known = np.array([False, True, True, True]), np.ones(4, bool)
    precision, recall, threshold = precision_recall(distance, correct, known)
    assert threshold.tolist() == [0.2, 0.5]
    assert precision.tolist() == [1, 0.5]
    assert recall.tolist() == [0.25, 0.25]
    nothing = precision_recall(distance * np.nan, correct, known)[:2]
    assert average_precision(*nothing) == 0
    assert recall_at_full_precision(*nothing) == 0


def test_without_a_true_place_there_is_no_recall_at_any_precision():
    precision, recall, _ = precision_recall(np.array([1.0, 2.0]), np.zeros(2, bool), np.zeros(2, bool))
    assert np.isnan(average_precision(precision, recall))
    assert np.isnan(recall_at_full_precision(precision, recall))


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=9))
def test_the_middle_of_numbers_in_order_is_numpys_median(numbers):
    assert middle(sorted(numbers)) == np.median(numbers)


@pytest.mark.parametrize("known_rate", [0.0, 0.02, 0.5, 1.0])
def test_curves_of_resamples_are_those_of_each_alone(known_rate):
    """Bit for bit, with ties, infinite distances, and resamples without a query that has a place."""
    rng = np.random.default_rng(7)
    distance = np.where(rng.random(60) < 0.1, np.inf, rng.integers(20, size=60) / 7)
    correct, known = rng.random(60) < 0.6, rng.random(60) < known_rate
    chosen = rng.integers(60, size=(40, 60))
    for row, (precision, recall) in zip(chosen, resampled_curves(distance, correct, known, chosen), strict=True):
        expected = precision_recall(distance[row], correct[row], known[row])[:2]
        np.testing.assert_array_equal(precision, expected[0])
        np.testing.assert_array_equal(recall, expected[1])


@pytest.mark.parametrize("count", [1, 7, 3001])
def test_a_vectorized_bootstrap_is_the_same(monkeypatch, count):
    """Also where not all resamples are drawn at once."""
    monkeypatch.setattr(metrics, "AT_ONCE", 10_000)
    values = np.random.default_rng(2).normal(size=count)
    for statistic in (np.mean, np.median):
        alone = bootstrap(lambda chosen: float(statistic(values[chosen])), count, np.random.default_rng(3), 50)  # noqa: B023
        at_once = bootstrap(lambda chosen: statistic(values[chosen], axis=1), count, np.random.default_rng(3), 50, True)  # noqa: B023
        assert at_once == alone
