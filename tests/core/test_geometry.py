"""Angles and rigid motions against scipy and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial import procrustes as scipy_procrustes
from scipy.spatial.transform import Rotation

from omnilab import geometry
from omnilab.geometry import heading_of, planar_poses, procrustes, quaternion_xyzw, spanned, wrap_angle

angles = st.floats(-50, 50)


@given(angles)
def test_wrapped_angles_are_the_same_direction_in_range(angle):
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-12)


@given(angles, st.floats(-9, 9), st.floats(-9, 9))
def test_a_planar_pose_takes_the_cameras_x_to_its_heading(heading, x, y):
    T = planar_poses([[x, y, 1.0]], heading)[0]
    ahead = T @ [1, 0, 0, 1]
    assert np.allclose(ahead, [x + np.cos(heading), y + np.sin(heading), 1, 1])
    assert np.isclose(np.exp(1j * heading_of(T)), np.exp(1j * heading))


@given(st.integers(0, 2**32 - 1))
def test_quaternions_agree_with_scipy_in_order_and_sign(seed):
    rotation = Rotation.random(20, random_state=seed)
    expected = rotation.as_quat(canonical=True)  # x, y, z, w with w >= 0
    assert np.allclose(quaternion_xyzw(rotation.as_matrix()), expected, atol=1e-9)


def test_quaternions_of_half_turns_have_no_weak_component():
    for axis in np.eye(3):
        matrix = Rotation.from_rotvec(np.pi * axis).as_matrix()
        assert np.allclose(np.abs(quaternion_xyzw(matrix)), [*axis, 0], atol=1e-9)


@given(hnp.arrays(float, 3, elements=st.floats(-7, 7)))
def test_rotations_about_the_axes_come_in_the_order_of_the_thesis(angles):
    ours = geometry.rotation_xyz(*angles)
    assert np.allclose(ours, Rotation.from_euler("XYZ", angles).as_matrix(), atol=1e-12)


@given(hnp.arrays(float, 4, elements=st.floats(-2, 2)).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_a_quaternion_is_the_rotation_that_scipy_says(xyzw):
    R = geometry.rotation_of_quaternion(xyzw)
    assert np.allclose(R, Rotation.from_quat(xyzw).as_matrix(), atol=1e-12)
    back = geometry.quaternion_xyzw(R)
    assert np.allclose(geometry.rotation_of_quaternion(back), R, atol=1e-9)


def test_poses_hold_positions_and_rotations():
    R = geometry.rotation_xyz([0, 0.3], 0, [1, -2])
    T = geometry.poses([[1, 2, 3], [4, 5, 6]], R)
    assert np.array_equal(T[:, :3, :3], R)
    assert np.array_equal(T[:, :3, 3], [[1, 2, 3], [4, 5, 6]])
    assert np.array_equal(geometry.poses([1, 2, 3], np.eye(3))[0], geometry.planar_poses([1, 2, 3])[0])


def similarities(rng, batch, d, reflection):
    """Random scales, turns (or mirrored turns), shifts."""
    R = np.linalg.qr(rng.standard_normal((batch, d, d)))[0]
    wanted = np.where(reflection, -1.0, 1.0)
    R[:, :, 0] *= (wanted / np.linalg.det(R))[:, None]
    return rng.uniform(0.01, 100, batch), R, rng.uniform(-50, 50, (batch, d))


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.integers(4, 20), st.booleans())
def test_procrustes_finds_the_similarity_that_moved_the_points(seed, d, count, mirrored):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (5, count, d))
    scale, R, t = similarities(rng, 5, d, mirrored)
    target = scale[:, None, None] * np.einsum("bij,bnj->bni", R, source) + t[:, None]
    found = procrustes(source, target)
    assert np.allclose(found.scale, scale, rtol=1e-9)
    assert np.allclose(found.R, R, atol=1e-6)
    assert np.allclose(found.apply(source), target, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.integers(4, 20))
def test_procrustes_leaves_the_residual_that_scipy_leaves(seed, d, count):
    rng = np.random.default_rng(seed)
    source, target = rng.standard_normal((2, count, d))
    residual = target - procrustes(source, target).apply(source)
    spread = ((target - target.mean(axis=0)) ** 2).sum()
    assert np.isclose((residual**2).sum() / spread, scipy_procrustes(target, source)[2], atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.booleans(), st.booleans())
def test_no_small_change_of_the_similarity_fits_better(seed, d, scale, reflection):
    rng = np.random.default_rng(seed)
    source, target = rng.standard_normal((2, 8, d))
    best = procrustes(source, target, scale, reflection)
    turn = np.eye(d)
    turn[:2, :2] = [[np.cos(0.01), -np.sin(0.01)], [np.sin(0.01), np.cos(0.01)]]
    others = [best._replace(R=turn @ best.R), best._replace(R=turn.T @ best.R), best._replace(t=best.t + 0.01)]
    others += [best._replace(scale=best.scale * f) for f in (0.99, 1.01)] if scale else []

    def misfit(s):
        return ((target - s.apply(source)) ** 2).sum()

    recentred = [s._replace(t=s.t + (target - s.apply(source)).mean(axis=0)) for s in others[:2]]
    assert all(misfit(s) >= misfit(best) for s in [*others, *recentred])
    assert scale or best.scale == 1
    assert np.isclose(np.abs(np.linalg.det(best.R)), 1)
    assert reflection or np.linalg.det(best.R) > 0


def test_without_reflections_a_mirrored_figure_is_only_turned():
    source = np.array([[0.0, 0], [3, 0], [0, 1]])
    mirrored = source * [1, -1]
    assert np.allclose(procrustes(source, mirrored).apply(source), mirrored)
    turned = procrustes(source, mirrored, reflection=False)
    assert np.isclose(np.linalg.det(turned.R), 1)
    assert not np.allclose(turned.apply(source), mirrored, atol=0.1)


@pytest.mark.parametrize("d", [2, 3])
def test_on_a_line_the_turn_is_answered_and_the_line_is_told(d):
    rng = np.random.default_rng(2)
    line = np.outer(np.arange(5.0), rng.standard_normal(d))
    _, R, t = similarities(rng, 1, d, True)
    target = line @ R[0].T + t[0]
    found = procrustes(line, target)
    assert np.isclose(np.linalg.det(found.R), 1)
    assert np.allclose(found.apply(line), target)
    assert spanned(line) == spanned(target) == 1
    assert np.array_equal(spanned(np.stack([line, rng.standard_normal((5, d)), np.full((5, d), 0.1)])), [1, d, 0])


def test_points_that_coincide_keep_their_scale():
    found = procrustes(np.ones((4, 2)), np.arange(8.0).reshape(4, 2))
    assert found.scale == 1
    assert np.allclose(found.apply(np.ones((4, 2))), [3, 4])
    assert procrustes(np.arange(8.0).reshape(4, 2), np.ones((4, 2))).scale == 0


def test_points_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="finite"):
        procrustes([[0, np.nan], [1, 2]], np.ones((2, 2)))
