"""The zenith of a striped sky, whose edges are exact great circles, and what is made of pictures without edges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnilab.api import Circle, Floats
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror, ImageCircle
from omnilab.errors import DataError
from omnilab.testing import check_disturbance
from omnilab_appearance import Tilt, UprightAdjustment
from omnilab_appearance.disturbances.upright_adjustment import _upright

CAMERA = EquirectangularCamera(256, 128)
PIXELS = np.stack(np.meshgrid(np.arange(256.0), np.arange(128.0)), -1)


def stripes(directions: Floats) -> Floats:
    """Grey levels of a world of vertical stripes between two horizontal ones, in directions (..., 3)."""
    azimuth, height = np.arctan2(directions[..., 1], directions[..., 0]), directions[..., 2]
    grey = 120 + 50 * np.tanh(3 * np.sin(7 * azimuth)) + 30 * np.tanh(3 * np.sin(3 * azimuth + 1))
    return np.rint(60 + (grey - 60) / (1 + np.exp(30 * (np.abs(height) - 0.6)))).astype(np.uint8)


def seen(R_world_camera: Floats) -> Floats:
    return stripes(CAMERA.directions(PIXELS) @ R_world_camera.T)[None]


def lean_deg(zenith: Floats, R_world_camera: Floats) -> float:
    return float(np.rad2deg(np.arccos(np.clip(zenith @ R_world_camera[2], -1, 1))))


@pytest.mark.parametrize("color", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["grey", "rgb"])
def test_keeps_the_contract(color):
    check_disturbance(UprightAdjustment(), UprightAdjustment(0), color)


@pytest.mark.parametrize("lean", [[0, 0, 0], [5, 0, 0], [0, -12, 70], [10, 13, -140]])
def test_the_zenith_is_where_the_vertical_lines_meet(lean):
    R = (
        Rotation.from_rotvec(np.deg2rad([*lean[:2], 0])).as_matrix()
        @ Rotation.from_euler("z", lean[2], degrees=True).as_matrix()
    )
    adjustment = UprightAdjustment()
    assert lean_deg(adjustment.zenith(seen(R)[0]), R) < 0.3
    upright = adjustment.apply(seen(R), CAMERA, [np.random.default_rng(0)])
    assert lean_deg(adjustment.zenith(upright[0]), np.eye(3)) < 0.5
    # but for the heading it is the picture of the upright camera
    heading = np.arctan2(*(R @ _upright(R[2]).T)[1::-1, 0])
    expected = seen(Rotation.from_euler("z", heading).as_matrix())
    left, before = (np.abs(images.astype(float) - expected).mean() for images in (upright, seen(R)))
    assert left < 3
    assert before > 3 * left or not any(lean)


def test_the_disturbance_tilt_is_undone():
    mirror = HyperbolicMirror(200)
    u, v = np.meshgrid(np.arange(200.0), np.arange(200.0))
    upright = stripes(mirror.directions(np.stack([u, v], -1)))[None]
    rngs = [np.random.default_rng(1)]
    leaning = Tilt(8.0, axis_deg=25).apply(upright, mirror, rngs)
    found = UprightAdjustment().apply(leaning, mirror, rngs)
    both = (found > 0) & (np.hypot(u - 99.5, v - 99.5) < 90)

    def off(images: Floats) -> float:
        return float(np.abs(images.astype(float) - upright)[both].mean())

    assert off(found) < off(leaning) / 3


def test_without_edges_nothing_is_done():
    flat = np.full((1, 128, 256), 77, np.uint8)
    np.testing.assert_array_equal(UprightAdjustment().apply(flat, CAMERA, [np.random.default_rng(0)]), flat)
    black = np.zeros_like(flat)
    np.testing.assert_array_equal(UprightAdjustment().apply(black, CAMERA, [np.random.default_rng(0)]), black)


def test_an_uncalibrated_camera_is_refused_in_a_sentence():
    circle = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
    with pytest.raises(
        DataError, match=r"needs a camera that knows where its pixels look, which ImageCircle does not; leave"
    ):
        UprightAdjustment().apply(np.zeros((1, 16, 16), np.uint8), circle, [np.random.default_rng(0)])
