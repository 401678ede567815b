"""Verdicts and estimates against cases worked by hand."""

import math

import numpy as np
import pytest
from scipy import stats

from omnilab.runner.fidelity.measured import MeasuredValue
from omnilab.runner.fidelity.verdicts import (
    BY_VARIANT,
    NOT_MEASURED,
    NOT_REACHED,
    NOT_TESTED,
    OTHER_ORDER,
    REACHED,
    Expectation,
    SeedEstimate,
    estimate,
    is_open,
    verdict,
)


def these(*values):
    return {str(i): SeedEstimate(value, 1) for i, value in enumerate(values)}


@pytest.mark.parametrize(
    ("expect", "values", "holds"),
    [
        ({"at_least": 0.8}, [0.8], True),
        ({"at_least": 0.8}, [0.79], False),
        ({"at_most": 6}, [6.0], True),
        ({"at_most": 6}, [math.nan], False),
        ({"about": 0.79, "within": 0.08}, [0.87], True),
        ({"about": 0.79, "within": 0.08}, [0.70], False),
        ({"at_least": 5, "at_most": 20}, [21], False),
        ({"at_least": 5, "at_most": 20}, [5], True),
        ({"order": "falling"}, [3, 2, 1], True),
        ({"order": "falling"}, [3, 3, 1], False),
        ({"order": "rising"}, [1, 2, 3], True),
        ({"order": "rising"}, [1, 3, 2], False),
        ({"order": "rising"}, [1, math.nan, 2], False),
    ],
)
def test_what_is_expected(expect, values, holds):
    assert Expectation.parsed(expect).holds([SeedEstimate(value, 1) for value in values]) is holds


def test_the_words_of_what_is_expected():
    assert Expectation.parsed({"about": 0.79, "within": 0.08}).words == "0.79 ± 0.08"
    assert Expectation.parsed({"at_least": 5, "at_most": 20}).words == "at least 5, at most 20"
    assert Expectation.parsed({"order": "falling"}).words == "falling, in this order"


def test_verdicts():
    least, order = Expectation.parsed({"at_least": 1}), Expectation.parsed({"order": "rising"})
    assert verdict(least, these(1), None) == REACHED
    assert verdict(least, these(1), these(0)) == REACHED
    assert verdict(least, these(0), these(1)) == BY_VARIANT
    assert verdict(least, None, these(1)) == BY_VARIANT
    assert verdict(least, these(0), these(0)) == NOT_REACHED
    assert verdict(least, these(0), None) == NOT_REACHED
    assert verdict(least, None, these(0)) == NOT_MEASURED
    assert verdict(order, these(2, 1), None) == OTHER_ORDER
    assert verdict(order, None, None) == NOT_MEASURED
    assert verdict(None, None, None) == NOT_TESTED


@pytest.mark.parametrize("values", [[1.0, 2.0], [0.3, 0.1, 0.8, 0.4], [5.0, 5.0, 5.0]])
def test_intervals_over_seeds_are_students(values):
    found = estimate([MeasuredValue(value, 0, 9) for value in values])
    sem = stats.sem(values)
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), sem) if sem else (values[0], values[0])
    assert (found.value, found.low, found.high) == pytest.approx((np.mean(values), low, high))
    assert found.seeds == len(values)


def test_one_run_has_its_own_interval_or_none():
    assert estimate([MeasuredValue(0.5, 0.4, 0.6, "m")]) == SeedEstimate(0.5, 1, 0.4, 0.6, "m")
    assert estimate([MeasuredValue(0.5)]) == SeedEstimate(0.5, 1)


def test_a_verdict_is_open_where_a_limit_or_the_next_value_lies_in_an_interval():
    def between(low, high):
        return SeedEstimate((low + high) / 2, 1, low, high)

    least, near, order = (
        Expectation.parsed(e) for e in ({"at_least": 0.5}, {"about": 1, "within": 0.1}, {"order": "falling"})
    )
    assert least.open([between(0.4, 0.7)])
    assert not least.open([between(0.6, 0.7)])
    assert not least.open([SeedEstimate(0.5, 1)])
    assert near.open([between(1.05, 1.2)])
    assert order.open([between(2, 4), between(1, 3)])
    assert not order.open([between(2, 4), between(0, 1)])
    assert order.open([between(2, 4), SeedEstimate(3, 1)])
    assert order.open([between(1, 3), between(2, 4)])
    assert not order.open([between(1, 3), between(2, 4), between(5, 6)]), "the last one is above them in any case"
    assert not order.open([SeedEstimate(2, 1), SeedEstimate(2, 1)])
    protocol, variant = {"": between(0.1, 0.2)}, {"": between(0.4, 0.9)}
    assert is_open(least, protocol, variant), "the variant decides"
    assert not is_open(least, protocol, None)
    assert not is_open(least, None, None)
    assert not is_open(None, None, None)
