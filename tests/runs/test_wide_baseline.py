"""Images that were taken metres apart in the shipped room: guided matches along epipolar great circles."""

import numpy as np
import pytest

from omnilab.api import ImageFeatures, PathPoses
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses, wrap_angle
from omnilab.testing import check_odometry
from omnilab_appearance import GuidedEpipolar, PlanarEpipolar
from omnilab_appearance.common.guided_matches import allowed, guided_matches
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.relative_pose import RelativePose, sampson_errors
from omnilab_appearance.common.spherical_features import match_features
from omnilab_appearance.odometries.planar_epipolar import Length
from omnilab_mirror import Mirror

POSES = np.array([[-3.0, -1.8, 0.2], [-2.0, -1.0, 1.0], [-0.4, 0.6, -2.0]])  # x, y, heading: 1.3 and 2.3 m apart


@pytest.fixture(scope="module")
def room():
    sensor = Mirror(size=300, samples=1)
    return next(
        iter(sensor.frames(sensor.plan(PathPoses(planar_poses(np.insert(POSES[:, :2], 2, 1, 1), POSES[:, 2])))))
    )


def true_angles(one, other):
    """Bearing and rotation of one pose (3,) from another."""
    dx, dy = other[:2] - one[:2]
    return np.array([np.arctan2(dy, dx) - one[2], other[2] - one[2]])


def test_it_keeps_the_contract_of_odometries(room):
    check_odometry(GuidedEpipolar(), room)


def test_far_images_stay_alike_and_give_the_true_angles(room):
    alike = {}
    for odometry in (PlanarEpipolar(length=Length.unit), GuidedEpipolar()):
        first, _, far = odometry.extract(room)
        motion = odometry.estimate(first, far, np.random.default_rng(0))
        assert (motion.failed, motion.unit) == ("", "1")
        assert np.hypot(*motion.vector[:2]) == pytest.approx(1)
        found = [np.arctan2(motion.vector[1], motion.vector[0]), motion.vector[2]]
        assert np.abs(wrap_angle(found - true_angles(POSES[0], POSES[2]))).max() < np.deg2rad(1)
        alike[type(odometry)] = 2 * motion.agree.sum() / motion.features
    assert alike[GuidedEpipolar] > 1.4 * alike[PlanarEpipolar]


def test_a_wrong_pose_makes_images_hardly_alike(room):
    first, _, far = GuidedEpipolar().extract(room)
    bearing, rotation = true_angles(POSES[0], POSES[2])

    def share(off):
        pose = RelativePose(rotation + off, bearing - off, np.eye(2), np.zeros(0, bool), 0.0)
        i, _ = guided_matches(first, far, pose, np.deg2rad(0.5), 0.95, 0.75)
        return 2 * len(i) / (len(first.vectors) + len(far.vectors))

    assert share(0.0) > 0.15
    assert max(share(off) for off in (0.7, -1.2, 2.5)) < 0.08


def test_what_a_pose_allows_are_points_in_front_near_their_planes():
    rng = np.random.default_rng(1)
    points = rng.uniform(-4, 4, (60, 3))
    phi, beta = 0.7, -1.1
    step = np.array([np.cos(beta), np.sin(beta), 0])
    c, s = np.cos(phi), np.sin(phi)
    seen = (points - step) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    p, q = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (points, seen))
    pose = RelativePose(phi, beta, np.eye(2), np.zeros(0, bool), 0.0)
    fits = allowed(p, q, pose, np.deg2rad(0.5))
    assert fits.diagonal().all()
    for i, j in zip(*np.nonzero(fits), strict=True):
        assert sampson_errors(p[i : i + 1], q[j : j + 1], phi, beta)[0] < np.deg2rad(0.5)
    backwards = RelativePose(phi, beta + np.pi, np.eye(2), np.zeros(0, bool), 0.0)
    assert allowed(p, q, backwards, np.deg2rad(0.05)).diagonal().mean() < 0.2  # the parallax has the other sign


def test_what_looks_alike_is_told_apart_by_where_it_is():
    p = np.array([[1, 0, 0.5], [0, 1, 0.5], [0.6, 0.8, 0.4]])
    points = 2 * p / np.linalg.norm(p, axis=1, keepdims=True)
    q = points - [0.5, 0, 0]
    vectors = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    one, other = (
        ImageFeatures(d / np.linalg.norm(d, axis=1, keepdims=True), np.zeros((3, 2)), vectors) for d in (points, q)
    )
    np.testing.assert_array_equal(match_features(one, other, 0.8)[0], [2])
    pose = RelativePose(0.0, 0.0, np.eye(2), np.zeros(0, bool), 0.0)
    i, j = guided_matches(one, other, pose, np.deg2rad(0.5), 0.95, 0.75)
    np.testing.assert_array_equal(i, [0, 1, 2])
    np.testing.assert_array_equal(j, [0, 1, 2])


def test_upright_features_are_of_sift():
    with pytest.raises(ConfigError, match="upright=true is for detector=sift, not surf; give upright=false, or sift"):
        GuidedEpipolar(detector=Detector.surf)
