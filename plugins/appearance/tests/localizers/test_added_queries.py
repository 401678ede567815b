"""Queries added to a map of their places: a constant in their squared distances does not move them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.geometry import procrustes
from omnilab.testing import check_embedder
from omnilab_appearance import Gower, Smacof
from omnilab_appearance.localizers.gower import with_added


def apart(points):
    return np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)


def occluded(points, offset):
    """Distances of points (B, n, 2), those of the last with a constant more in their squares."""
    lengths = apart(points)
    lengths[:, -1, :-1] = lengths[:, :-1, -1] = np.sqrt(lengths[:, -1, :-1] ** 2 + offset)
    return lengths


@pytest.mark.slow
def test_keeps_the_contract():
    check_embedder(Gower())


@given(st.integers(0, 2**32 - 1), st.integers(4, 12), st.floats(0, 100), st.floats(1e-3, 1e3))
@settings(max_examples=25)
def test_a_constant_in_its_squared_distances_does_not_move_the_query(seed, n, offset, scale):
    points = scale * np.random.default_rng(seed).uniform(-1, 1, (2, n, 2))
    made = Gower().embed(occluded(points, offset * scale**2), np.random.default_rng(0)).position
    fitted = procrustes(made[:, :-1], points[:, :-1], scale=False).apply(made)
    assert np.abs(fitted - points).max() < 1e-4 * scale * (1 + offset)


def test_a_map_of_all_points_pushes_it_out():
    points = np.random.default_rng(2).uniform(-1, 1, (1, 10, 2))
    lengths = occluded(points, 4.0)

    def error(maker):
        made = maker.embed(lengths, np.random.default_rng(0)).position
        fitted = procrustes(made[:, :-1], points[:, :-1]).apply(made)
        return float(np.linalg.norm(fitted[0, -1] - points[0, -1]))

    assert error(Smacof()) > 0.5
    assert error(Gower()) < 1e-5


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_it_is_the_least_squares_of_the_linear_equations(seed):
    """|x_i|² - d_i² = 2 x_i q - c, weighed, by a general solver."""
    rng = np.random.default_rng(seed)
    places, square, weight = rng.normal(size=(1, 8, 2)), rng.uniform(0, 4, (1, 8)), rng.uniform(0.1, 2, (1, 8))
    equations = np.column_stack([2 * places[0], -np.ones(8)]) * np.sqrt(weight[0])[:, None]
    right = ((places[0] ** 2).sum(axis=1) - square[0]) * np.sqrt(weight[0])
    assert np.allclose(with_added(places, square, weight)[0, -1], np.linalg.lstsq(equations, right, rcond=None)[0][:2])


def test_places_on_a_line_and_distances_that_do_not_count_leave_a_point():
    line = np.column_stack([np.arange(4.0), np.zeros(4)])[None]
    found = with_added(line, (np.arange(4.0)[None] - 1.5) ** 2 + 1, np.ones((1, 4)))
    assert np.allclose(found[0, -1], [1.5, 0])
    assert np.allclose(with_added(line, np.ones((1, 4)), np.zeros((1, 4)))[0, -1], [1.5, 0])
    points = np.random.default_rng(3).uniform(-1, 1, (1, 9, 2))
    lengths = occluded(points, 1.0)
    lengths[0, -1, 2] = lengths[0, 2, -1] = np.inf
    made = Gower().embed(lengths, np.random.default_rng(0)).position
    assert np.allclose(apart(made[:, [8, 0, 5]]), apart(points[:, [8, 0, 5]]), atol=1e-4)
