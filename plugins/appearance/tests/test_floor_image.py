"""Lengths by pictures of the floor, against scenes whose every ray is intersected."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from omnilab.api import Frames
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror
from omnilab.errors import ConfigError
from omnilab_appearance import PlanarEpipolar
from omnilab_appearance.odometries.floor_image import floor_pictures, floor_step
from omnilab_appearance.odometries.planar_epipolar import Length

CAMERAS = [EquirectangularCamera(800, 400), HyperbolicMirror(720, crop=1.0, a_mm=23.5, b_mm=80.8, rim_mm=64.15)]


@cache
def texture(contrast):
    rng = np.random.default_rng(0)
    return 100 + contrast * gaussian_filter(rng.normal(size=(1024, 1024)), 2, mode="wrap") / 0.14


def above(camera, x, y, heading, contrast=10.0, box=0.0):
    """A floor one height below the camera, and right of x = 0.4 boxes as high as `box`, of the same texture."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    d = camera.directions(np.stack([u, v], -1))
    c, s = np.cos(heading), np.sin(heading)
    d = d @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    found = np.zeros(u.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        for height in (0.0, box) if box else (0.0,):
            reach = -(1 - height) / d[..., 2]
            px, py = x + reach * d[..., 0], y + reach * d[..., 1]
            where = np.nan_to_num(np.stack([512 + 100 * px, 300 * (height > 0) + 100 * py]))
            hit = (d[..., 2] < 0) & (reach < 5) & ((height == 0) | (px > 0.4))
            found = np.where(hit, map_coordinates(texture(contrast), where, order=1, mode="grid-wrap"), found)
    return np.clip(np.round(found), 0, 255).astype(np.uint8)


def step_of(camera, length, phi, beta, **scene):
    images = [above(camera, 0, 0, 0.3, **scene)]
    images.append(above(camera, length * np.cos(0.3 + beta), length * np.sin(0.3 + beta), 0.3 + phi, **scene))
    return floor_step(*floor_pictures(np.stack(images), camera), phi, beta)


@pytest.mark.parametrize("camera", CAMERAS, ids=["sphere", "mirror"])
@pytest.mark.parametrize(("length", "phi", "beta"), [(0.12, 0.0, 0.4), (0.23, -2.0, -1.1)])
def test_the_length_is_that_of_the_motion(camera, length, phi, beta):
    step = step_of(camera, length, phi, beta)
    assert step.failed == ""
    assert step.length == pytest.approx(length, rel=0.015)
    assert abs(step.length - length) < 3 * np.sqrt(step.variance)


def test_what_stands_on_the_floor_does_not_stretch_it():
    """Boxes of a third of the camera's height move half as far again."""
    assert step_of(CAMERAS[0], 0.12, 0.2, 0.5, box=1 / 3).length == pytest.approx(0.12, rel=0.02)


@pytest.mark.parametrize(("scene", "length"), [({"contrast": 0.0}, 0.1), ({}, 0.0), ({}, 2.9)])
def test_without_a_texture_or_a_motion_or_a_common_floor_it_fails(scene, length):
    step = step_of(CAMERAS[0], length, 0.0, 0.4, **scene)
    assert step.failed.endswith("tiles of the floor agree")
    assert np.isnan(step.length)


def test_it_is_a_length_of_the_odometry():
    camera = CAMERAS[0]
    images = np.stack([above(camera, 0, 0, 0), above(camera, 0.1, 0, 0.1)])
    frames = Frames(images, ["a", "b"], np.arange(2), camera, np.arange(2))
    odometry = PlanarEpipolar(length=Length.floor_image, height_m=2.0)
    a, b = odometry.extract(frames)
    motion = odometry.estimate(a, b, np.random.default_rng(0))
    assert motion.unit == "m"
    np.testing.assert_allclose(motion.vector, [0.2, 0.0, 0.1], atol=0.006)
    plain = PlanarEpipolar().extract(frames)
    with pytest.raises(ConfigError, match="length=floor_image was given features that were extracted with another"):
        odometry.estimate(*plain, np.random.default_rng(0))
