"""What the study of trajectories is made of: unknown scales, poses moved along the path, pictures of matches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Circle, Frames, Motion, PoseGraph
from omnilab.cameras import ImageCircle
from omnilab.geometry import heading_of, planar_poses
from omnilab.posegraph.graph import between, moved
from omnilab_studies.common.match_images import draw_matches
from omnilab_studies.trajectory.scale_estimation import optimize
from omnilab_studies.trajectory.study import jittered

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@settings(max_examples=25, deadline=None)
@given(factor=st.floats(0.05, 20), seed=st.integers(0, 1000))
def test_an_unknown_factor_is_found_exactly(factor, seed, plain):
    rng = np.random.default_rng(seed)
    truth = np.column_stack([rng.uniform(-2, 2, (6, 2)), rng.uniform(-3, 3, 6)])
    chain = np.column_stack([np.arange(5), np.arange(1, 6)])
    edges = np.concatenate([chain, [[0, 3], [0, 5]]])
    motions = between(truth, edges)
    motions[:5, :2] /= factor
    information = np.tile(100 * np.eye(3), (7, 1, 1))
    information[:5, :2, :2] *= factor**2
    graph = PoseGraph(
        np.arange(6), truth + [0.1, -0.1, 0.05] * (np.arange(6) > 0)[:, None], edges, motions, information
    )
    found, factors = optimize(plain["Least"](), graph, np.array([0] * 5 + [-1] * 2), np.array([1.3 * factor]))
    assert factors[0] == pytest.approx(factor, rel=1e-3)
    assert found.poses[:, :2] == pytest.approx(truth[:, :2], abs=0.01)


def test_without_unknown_factors_the_graph_is_optimised_once(plain):
    graph = PoseGraph(np.arange(2), np.zeros((2, 3)), np.array([[0, 1]]), np.array([[1.0, 0, 0]]), np.eye(3)[None])
    found, factors = optimize(plain["Least"](), graph, np.array([-1]), np.array([0.7]))
    assert found.poses[1] == pytest.approx([1, 0, 0])
    assert factors.tolist() == [0.7]


@settings(max_examples=30, deadline=None)
@given(share=st.floats(0, 0.49), seed=st.integers(0, 1000))
def test_jittered_poses_stay_on_the_path_and_in_order(share, seed):
    shift = np.random.default_rng(seed).uniform(-share, share, 9)
    straight = planar_poses(np.column_stack([np.arange(9.0), np.zeros(9), np.ones(9)]), 0.5 * np.arange(9.0))
    moved_on = jittered(straight, shift)
    at = moved_on[:, 0, 3]
    assert at == pytest.approx(np.clip(np.arange(9) + shift, 0, 8))
    assert (np.diff(at) > 0).all()
    assert np.unwrap(heading_of(moved_on)) == pytest.approx(0.5 * at)  # across half a turn, too


def test_matches_are_drawn_from_where_a_mere_rotation_would_leave_them():
    black = Frames(np.zeros((1, 16, 16), np.uint8), ["a"], np.zeros(1, int), CAMERA, np.zeros(1, int))
    rotation = 0.3
    stays = np.array([[[1.0, 0.5], [1.0 - rotation, 0.5]], [[2.0, 0.5], [2.2 - rotation, 0.5]]])
    motion = Motion(np.array([1, 0, rotation]), np.eye(3), "m", "", stays, np.array([True, False]))
    picture = draw_matches(black, motion)
    red, green = (picture[:, :, channel].astype(int) for channel in (0, 1))
    good, bad = ((one - other > 60).any(axis=0) for one, other in ((green, red), (red, green)))
    assert np.ptp(np.flatnonzero(good)) <= 6  # no more than its dot
    assert np.ptp(np.flatnonzero(bad)) == pytest.approx(0.2 / (2 * np.pi) * picture.shape[1], abs=4)
    column = picture.shape[1] - 1 - (1.0 - rotation) / (2 * np.pi) * picture.shape[1]
    assert np.flatnonzero(good).mean() == pytest.approx(column, abs=1.5)  # azimuth falls to the right


def test_the_winning_half_is_bright():
    grey = Frames(np.full((1, 16, 16), 100, np.uint8), ["a"], np.zeros(1, int), CAMERA, np.zeros(1, int))
    picture = draw_matches(grey, Motion(np.zeros(3), np.eye(3), "m", window_rad=0.0))[:, ::-1]
    half = picture.shape[1] // 2
    assert picture[:, :half].mean() == pytest.approx(100, abs=1)
    assert picture[:, half:].mean() == pytest.approx(50, abs=1)
    assert moved(np.zeros(3), np.array([1.0, 0, 0])).tolist() == [1, 0, 0]
