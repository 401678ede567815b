"""Odometry from appearance on rendered pictures of a room: which way is which, on known motions."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import PathPoses
from omnilab.geometry import planar_poses, wrap_angle
from omnilab.posegraph.graph import inverse, vectors
from omnilab.testing import check_odometry
from omnilab_appearance import Appearance, AppearanceFit
from omnilab_appearance.odometries.appearance import Ties
from omnilab_mirror import Mirror

# each step goes another way as the camera sees it: ahead, left, back, right, and slantwise while it turns
STEPS_M = [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1), (0, 0), (0.07, 0.07)]
HEADINGS_DEG = [0, 0, 0, 0, 0, 40]
START_M = (-1.5, -1.5)


@pytest.fixture(scope="module")
def room():
    mirror = Mirror(size=250, samples=1)
    at = np.column_stack([np.array(STEPS_M) + START_M, np.ones(len(STEPS_M))])
    (frames,) = mirror.frames(mirror.plan(PathPoses(planar_poses(at, np.deg2rad(HEADINGS_DEG)))))
    return frames


@pytest.mark.parametrize(
    ("odometry", "within_deg"), [(Appearance(), 45), (Appearance(ties=Ties.middle), 45), (AppearanceFit(), 20)]
)
def test_turns_and_directions_have_the_signs_of_the_known_motion(room, odometry, within_deg):
    check_odometry(odometry, room)
    features, rng = odometry.extract(room), np.random.default_rng(0)
    estimates = np.array(
        [odometry.estimate(features[i], features[i + 1], rng).vector for i in range(len(features) - 1)]
    )
    truth = vectors(inverse(room.T_world_camera[:-1]) @ room.T_world_camera[1:], planar=True)
    off = np.rad2deg(wrap_angle(np.arctan2(estimates[:, 1], estimates[:, 0]) - np.arctan2(truth[:, 1], truth[:, 0])))
    assert np.abs(off).max() < within_deg
    assert np.rad2deg(estimates[:, 2]) == pytest.approx(np.rad2deg(truth[:, 2]), abs=1.5)
