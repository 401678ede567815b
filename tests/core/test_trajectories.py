"""Errors of trajectories, by closed forms; the numbers were also held against evo 1.38.1, which agrees to 1e-15."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnilab.errors import DataError
from omnilab.geometry import planar_poses, poses
from omnilab.trajectory.evaluation import (
    Alignment,
    aligned,
    evaluate,
    pairs_apart,
    path_length,
    relative_errors,
)
from omnilab.trajectory.files import kitti_text, tum_text


@pytest.fixture
def truth():
    """Half a lap of a helix of radius 2 m."""
    t = np.linspace(0, np.pi, 50)
    R = Rotation.from_euler("zyx", np.column_stack([t, 0.1 * t, -0.2 * t])).as_matrix()
    return poses(np.column_stack([2 * np.cos(t), 2 * np.sin(t), 0.3 * t]), R)


@pytest.fixture
def flat():
    t = np.linspace(0, 4, 40)
    return planar_poses(np.column_stack([t, np.sin(2 * t), 0 * t]), t)


def placed(T, scale=1.0, turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """The same trajectory in another frame, at another scale."""
    W = poses([shift], Rotation.from_rotvec(turn).as_matrix())[0]
    moved = W @ T
    moved[:, :3, 3] *= scale
    return moved


@pytest.mark.parametrize(
    ("alignment", "frame"),
    [
        (Alignment.none, {}),
        (Alignment.first, {"turn": (0.3, -0.2, 1.0), "shift": (1, 2, 3)}),
        (Alignment.se2, {"turn": (0, 0, 2.0), "shift": (1, 2, 3)}),
        (Alignment.se3, {"turn": (0.3, -0.2, 1.0), "shift": (1, 2, 3)}),
        (Alignment.sim2, {"turn": (0, 0, 2.0), "shift": (1, 2, 3), "scale": 0.2}),
        (Alignment.sim3, {"turn": (0.3, -0.2, 1.0), "shift": (1, 2, 3), "scale": 5.0}),
    ],
)
def test_each_alignment_undoes_what_it_may(truth, alignment, frame):
    moved, scale = aligned(placed(truth, **frame), truth, alignment)
    assert np.allclose(moved, truth)
    assert scale == pytest.approx(1 / frame.get("scale", 1))
    found = evaluate(placed(truth, **frame), truth, alignment)
    for name in (
        "ate_m",
        "ate_max_m",
        "rpe_step_m",
        "rpe_step_rad",
        "rpe_metre_m",
        "rpe_metre_rad",
        "drift",
        "end_drift",
    ):
        assert abs(getattr(found, name)) < 1e-7, name


def test_an_alignment_undoes_no_more(truth):
    scaled, tilted = placed(truth, scale=1.3), placed(truth, turn=(0.5, 0, 0))
    assert evaluate(scaled, truth, Alignment.se3).ate_m > 0.1
    assert evaluate(tilted, truth, Alignment.sim2).ate_m > 0.1


def test_a_mirrored_map_scores_badly(flat):
    mirrored = flat.copy()
    mirrored[:, 1, 3] *= -1
    for alignment in (Alignment.sim2, Alignment.se2):
        assert evaluate(mirrored, flat, alignment).ate_m > 0.3


def test_a_map_that_shrank_to_nothing_tells_by_its_scale(flat):
    tiny = placed(flat, scale=1e-6)
    found = evaluate(tiny, flat, Alignment.sim2)
    assert found.scale == pytest.approx(1e6)


def test_errors_by_hand():
    """A straight path of 4 m in steps of 1 m; the third pose is 0.3 m aside, the last is turned by 0.1."""
    truth = planar_poses([[x, 0, 0] for x in range(5)])
    estimate = planar_poses([[0, 0, 0], [1, 0, 0], [2, 0.3, 0], [3, 0, 0], [4, 0, 0]], [0, 0, 0, 0, 0.1])
    found = evaluate(estimate, truth, Alignment.none)
    assert found.ate_m == pytest.approx(0.3 / np.sqrt(5))
    assert found.ate_max_m == pytest.approx(0.3)
    assert found.rpe_step_m == found.rpe_metre_m == pytest.approx(np.sqrt(2 * 0.3**2 / 4))
    assert found.rpe_step_rad == pytest.approx(0.1 / 2)
    assert found.scale == 1
    assert found.end_drift == 0


def test_drift_of_a_stretched_path_is_the_stretch():
    truth = planar_poses([[x, 0, 0] for x in np.linspace(0, 10, 101)])
    found = evaluate(placed(truth, scale=1.05), truth, Alignment.none)
    assert found.drift == pytest.approx(0.05)
    assert found.end_drift == pytest.approx(0.05)


def test_a_turn_at_the_start_shows_in_relative_errors_once():
    truth = planar_poses([[x, 0, 0] for x in range(4)])
    estimate = planar_poses([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 3, 0]], [0, np.pi / 2, np.pi / 2, np.pi / 2])
    metres, radians = relative_errors(estimate, truth, np.array([[0, 1], [1, 2], [2, 3]]))
    assert np.allclose(metres, [np.sqrt(2), 0, 0])
    assert np.allclose(radians, [np.pi / 2, 0, 0], atol=1e-7)


def test_pairs_follow_one_another_along_the_true_path():
    T = planar_poses([[x, 0, 0] for x in (0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.5)])
    assert np.allclose(path_length(T), [0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.5])
    assert pairs_apart(T, 1.0).tolist() == [[0, 3], [3, 6]]
    assert pairs_apart(T, 9.0).shape == (0, 2)


def test_a_robot_that_stands_still_has_no_drift():
    still = np.tile(np.eye(4), (5, 1, 1))
    found = evaluate(still, still, Alignment.se3)
    assert found.ate_m == 0
    assert np.isnan(found.drift)
    assert np.isnan(found.end_drift)
    assert np.isnan(found.rpe_metre_m)


def test_texts_read_back(truth):
    stamps = np.arange(50) * 123_456_789 + 1_700_000_000_000_000_001
    rows = [line.split() for line in tum_text(truth, stamps).splitlines()]
    assert rows[1][0] == "1700000000.123456790"
    values = np.array(rows, float)
    assert np.array_equal(values[:, 1:4], truth[:, :3, 3])
    assert np.allclose(Rotation.from_quat(values[:, 4:]).as_matrix(), truth[:, :3, :3])
    kitti = np.array([line.split() for line in kitti_text(truth).splitlines()], float)
    assert np.array_equal(kitti.reshape(-1, 3, 4), truth[:, :3])


def test_what_cannot_be_measured_is_one_sentence(truth):
    with pytest.raises(DataError, match="at least 2"):
        evaluate(truth[:1], truth[:1], Alignment.none)
    with pytest.raises(DataError, match=r"\(49, 4, 4\).*\(50, 4, 4\)"):
        evaluate(truth[:-1], truth, Alignment.none)
    with pytest.raises(DataError, match="NaN"):
        evaluate(truth * np.nan, truth, Alignment.none)
