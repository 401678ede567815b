"""Angles and rigid motions against scipy and closed forms."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from omnilab import geometry
from omnilab.geometry import heading_of, planar_poses, quaternion_xyzw, wrap_angle

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
