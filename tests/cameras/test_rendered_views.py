"""A world rendered through each camera beside the same world rendered on a sphere and reprojected: two ways to one picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omnilab.api import PathPoses
from omnilab.geometry import planar_poses
from omnilab.image import view_of
from omnilab_mirror import Cylindrical, Equirectangular, Fisheye, Mirror

WORLD = str(Path(__file__).parents[1] / "box_world.yaml")
POSES = PathPoses(planar_poses(np.array([[0.0, -1.0, 1.0], [-1.5, 0.5, 1.3]]), np.array([0.3, -2.0])))
SPHERE = Equirectangular(WORLD, width=1024, height=512, samples=1)


def taken(sensor):
    (frames,) = sensor.frames(sensor.plan(POSES))
    return frames.images, frames.camera


def seen_by(view, *sensors):
    return [view_of(*taken(sensor), view, False).astype(float) for sensor in sensors]


def test_a_sphere_seen_through_a_mirror_is_the_mirrors_picture():
    reprojected, direct = seen_by("mirror", SPHERE, Mirror(WORLD, samples=16))
    assert reprojected.shape == direct.shape
    assert np.abs(reprojected - direct).mean() < 1.5
    turned = np.rot90(direct, axes=(1, 2))
    assert np.abs(reprojected - turned).mean() > 15  # which another azimuth would be


@pytest.mark.parametrize(
    "sensor",
    [
        Mirror(WORLD, size=400, crop=1.0, samples=4),
        Cylindrical(WORLD, width=1024, height=256, samples=1),
        Fisheye(WORLD, size=260, focal_px=82, samples=4),
    ],
    ids=lambda sensor: type(sensor).__name__,
)
def test_what_any_camera_shows_of_the_sphere_is_there_on_its_own(sensor):
    own, whole = seen_by("sphere", sensor, SPHERE)
    shown = own > 0
    assert shown.mean() > 0.2
    assert np.abs(own - whole)[shown].mean() < 3
