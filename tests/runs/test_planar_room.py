"""Odometry by planar epipolar geometry in the shipped room."""

import numpy as np
import pytest

from omnilab.api import PathPoses
from omnilab.geometry import planar_poses, wrap_angle
from omnilab_appearance import PlanarEpipolar
from omnilab_appearance.common.spherical_features import match_features
from omnilab_mirror import Mirror

PATH = np.array([[0.0, -0.4, 0.3], [0.1, -0.38, 0.45], [0.12, -0.28, 0.2]])  # x, y, heading
HEIGHT_M = 1.25


@pytest.fixture(scope="module")
def room():
    sensor = Mirror(size=400)
    position = np.column_stack([PATH[:, :2], np.full(len(PATH), HEIGHT_M)])
    return next(iter(sensor.frames(sensor.plan(PathPoses(planar_poses(position, PATH[:, 2]))))))


@pytest.mark.parametrize("k", range(len(PATH) - 1))
def test_steps_in_the_room_are_estimated_in_metres(room, k):
    odometry = PlanarEpipolar(height_m=HEIGHT_M)
    before, now = odometry.extract(room)[k : k + 2]
    motion = odometry.estimate(before, now, np.random.default_rng(0))
    c, s = np.cos(PATH[k, 2]), np.sin(PATH[k, 2])
    forward = (PATH[k + 1, :2] - PATH[k, :2]) @ np.array([[c, -s], [s, c]])
    turn = wrap_angle(PATH[k + 1, 2] - PATH[k, 2])
    assert motion.failed == ""
    assert np.linalg.norm(motion.vector[:2] - forward) < 0.05 * np.linalg.norm(forward)
    assert abs(motion.vector[2] - turn) < np.deg2rad(0.2)


def test_matches_that_agree_follow_the_motion(room):
    odometry = PlanarEpipolar()
    before, now = odometry.extract(room)[:2]
    motion = odometry.estimate(before, now, np.random.default_rng(0))
    assert len(motion.agree) == len(match_features(before, now, odometry.ratio)[0])
    assert motion.agree.mean() > 0.7
