"""The half-window vote and the sine fit on displacements made by hand: azimuths grow counter-clockwise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.errors import ConfigError
from omnilab.geometry import wrap_angle
from omnilab_appearance.odometries.appearance import STARTS, Appearance, Ties, middle_of, votes
from omnilab_appearance.odometries.appearance_fit import AppearanceFit

COLUMN = 2 * np.pi / STARTS


def displacements(beta, count=200, seed=0):
    """Points all around, two steps away or more: azimuths (count,) after a step in direction beta, and how far they moved."""
    rng = np.random.default_rng(seed)
    azimuth, far = rng.uniform(-np.pi, np.pi, count), rng.uniform(2, 20, count)
    before = far * np.exp(1j * azimuth)
    after = before - np.exp(1j * beta)
    return np.angle(after), wrap_angle(np.angle(after) - np.angle(before))


@given(st.floats(-np.pi, np.pi), st.integers(0, 20))
@pytest.mark.parametrize("ties", list(Ties))
def test_the_vote_finds_where_the_camera_went(ties, beta, seed):
    found, window, offset = Appearance(ties=ties)._direction(*displacements(beta, 400, seed))
    assert abs(wrap_angle(found - beta)) < np.deg2rad(8)  # of 400 azimuths, none may lie in a few degrees
    assert abs(wrap_angle(window - found)) == pytest.approx(np.pi)
    assert offset == 0


@given(st.floats(-np.pi, np.pi), st.integers(0, 20))
def test_the_fit_finds_it_and_how_far_the_turn_is_off(beta, seed):
    azimuth, moved = displacements(beta, 200, seed)
    found, window, offset = AppearanceFit()._direction(azimuth, wrap_angle(moved + 0.02))
    assert abs(wrap_angle(found - beta)) < np.deg2rad(8)
    assert offset == pytest.approx(0.02, abs=0.02)
    assert window is None


@given(st.floats(-np.pi, np.pi))
def test_the_fit_is_exact_on_a_sine_with_wrong_matches_among_it(beta):
    rng = np.random.default_rng(3)
    azimuth = rng.uniform(-np.pi, np.pi, 100)
    moved = 0.1 * np.sin(azimuth - beta) - 0.03
    moved[:10] = rng.uniform(-3, 3, 10)
    found, _, offset = AppearanceFit()._direction(azimuth, moved)
    assert wrap_angle(found - beta) == pytest.approx(0, abs=0.01)
    assert offset == pytest.approx(-0.03, abs=1e-3)


def test_the_middle_of_the_ties_lies_between_what_moved_this_way_and_that():
    # a step ahead: what lies on the left moves to larger azimuths, what lies on the right to smaller ones
    azimuth, moved = np.deg2rad([90.0, -90.0]), np.array([0.1, -0.1])
    first, middle = (Appearance(ties=ties)._direction(azimuth, moved)[0] for ties in (Ties.first, Ties.middle))
    assert wrap_angle(middle) == pytest.approx(0, abs=COLUMN)
    assert abs(wrap_angle(first)) == pytest.approx(np.pi / 2, abs=COLUMN)  # the tie is half a turn wide


def test_votes_are_those_of_a_count_window_by_window():
    azimuth, moved = displacements(1.0, 50)
    moved[3] = 0  # says nothing
    slow = np.zeros(STARTS, int)
    for k in range(STARTS):
        for a, d in zip(azimuth, moved, strict=True):
            inside = (a - k * COLUMN) % (2 * np.pi) < np.pi
            slow[k] += d < 0 if inside else d > 0
    assert np.array_equal(votes(azimuth, moved), slow)


@pytest.mark.parametrize(
    ("chosen", "middle"),
    [
        ([5], 5), ([2, 3, 4], 3), ([0, 1, 10, 11], 11.5), ([1, 5, 6, 7], 6), ([0, 5, 6, 7, 11], 6),
        ([11, 0], 11.5), (list(range(12)), 0),
    ],
)  # fmt: skip
def test_the_middle_of_the_longest_run_in_a_ring_of_twelve(chosen, middle):
    assert middle_of(np.array(sorted(chosen)), 12) == pytest.approx(middle)


@pytest.mark.parametrize("wrong", [{"ratio": 0}, {"ratio": 1.1}, {"least": 1}, {"length_sigma": 0}])
def test_settings_that_match_nothing_are_refused(wrong):
    with pytest.raises(ConfigError, match="give"):
        Appearance(**wrong)
