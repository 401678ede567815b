"""Correlated errors of repeated observations: what they are worth, beside the exact estimator, and when nothing changes."""

import numpy as np
import pytest

from omnilab.api import Motion
from omnilab_studies.view_slam.front_end import angles_of
from omnilab_studies.view_slam.repeated_observations import MOST, RepeatedObservations


def factors(length_m, steps, element=0):
    repeats, found = RepeatedObservations(length_m), []
    for motion in steps:
        repeats.move(np.array(motion, float))
        found.append(repeats.factor(element))
    return found


@pytest.mark.parametrize(("length_m", "step_m"), [(0.17, 0.05), (0.3, 0.1), (0.05, 0.05)])
def test_many_are_worth_what_the_best_linear_estimate_makes_of_them(length_m, step_m):
    """A constant seen n times with Markov errors of variance 1: generalised least squares has 1 / (1' C^-1 1)."""
    n = 2000
    way = step_m * np.arange(n)
    C = np.exp(-np.abs(way[:, None] - way) / length_m)
    exact = 1 / np.linalg.solve(C, np.ones(n)).sum()
    found = 1 / np.sum(1 / np.array(factors(length_m, [(step_m, 0, 0)] * n)))
    assert found == pytest.approx(exact, rel=0.02)


def test_the_first_and_independent_ones_count_in_full():
    assert factors(0.0, [(0.01, 0, 0)] * 3) == [1.0, 1.0, 1.0]
    assert factors(0.2, [(0.01, 0, 0)])[0] == 1.0
    assert factors(0.2, [(100.0, 0, 0)] * 2)[1] == pytest.approx(1.0)
    repeats = RepeatedObservations(0.2)
    assert (repeats.factor(0), repeats.factor(1)) == (1.0, 1.0), "another element is another error"


def test_a_halt_tells_hardly_anything_and_a_rotation_counts_as_a_way():
    assert factors(0.2, [(0, 0, 0)] * 2)[1] == pytest.approx((1 + MOST) / (1 - MOST))
    assert factors(0.2, [(0, 0, 0.1)] * 2)[1] == pytest.approx(factors(0.2, [(0.06, 0.08, 0)] * 2)[1])
    assert factors(0.2, [(np.nan, 0, 0)] * 2)[1] == pytest.approx((1 + MOST) / (1 - MOST))


def test_the_scale_is_of_the_matches_alone():
    motion = Motion(np.array([0.6, 0.8, 0.3]), np.diag([1e-4, 2e-4, 3e-4]), "1")
    (angles, plain), (same, scaled) = angles_of(motion, 0.01), angles_of(motion, 0.01, 4.0)
    np.testing.assert_array_equal(angles, same)
    np.testing.assert_allclose(scaled - 1e-4 * np.eye(2), 4 * (plain - 1e-4 * np.eye(2)), atol=1e-18)
