"""Two fisheyes in one picture: each lens as it is alone, every direction once, and a sphere stitched from a rendered twin."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import PathPoses
from omnilab.cameras import DualFisheyeCamera, EquirectangularCamera, FisheyeCamera, load_camera, reproject, save_camera
from omnilab.cameras.dual_fisheye import side_by_side
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses, rotation_xyz
from omnilab.image import view_of
from omnilab_mirror import Calibrated, Equirectangular

WORLD = Path(__file__).parents[4] / "tests/box_world.yaml"

angles = st.tuples(*[st.floats(-180, 180)] * 3)
cameras = st.builds(
    lambda fov, k, front, back: replace(
        side_by_side(200, 100, fov), front_k=(k, 0.0, 0.0, 0.0), front_rpy_deg=front, back_rpy_deg=back
    ),
    st.floats(181, 220),
    st.floats(-0.02, 0.05),
    angles,
    angles,
)


def directions(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@given(cameras, st.integers(0, 2**32 - 1))
def test_every_direction_that_has_a_pixel_comes_back_from_it(camera, seed):
    d = directions(60, seed)
    uv = camera.pixels(d)
    shown = np.isfinite(uv).all(-1)
    assert shown.any()
    assert np.allclose(camera.directions(uv[shown]), d[shown], atol=1e-6)


@given(st.floats(181, 220))
def test_lenses_back_to_back_show_every_direction(fov):
    assert np.isfinite(side_by_side(200, 100, fov).pixels(directions(200))).all()


def test_each_half_is_a_fisheye_of_its_own():
    camera = side_by_side(200, 100, 200)
    focal = 50 / np.deg2rad(100)
    alone = FisheyeCamera(width=100, height=100, cx=49.5, cy=49.5, looks="ahead", focal_px=focal)
    ahead = np.array([[1, 0, 0], [0.9, 0.3, 0.2], [0.2, -0.9, 0.1]])
    assert np.allclose(camera.pixels(ahead), alone.pixels(ahead))
    behind = ahead * [-1, -1, 1]  # turned by 180 degrees about z
    assert np.allclose(camera.pixels(behind), alone.pixels(ahead) + np.array([100, 0]))


def test_a_lens_is_turned_as_it_is_said_to_be():
    upright, rolled = side_by_side(200, 100), replace(side_by_side(200, 100), front_rpy_deg=(90.0, 0.0, 0.0))
    d = np.array([0.8, 0.3, 0.5])
    assert np.allclose(rolled.pixels(rotation_xyz(np.pi / 2, 0, 0) @ d), upright.pixels(d))


def test_pictures_flipped_left_to_right_have_the_flipped_camera():
    camera = replace(side_by_side(200, 100), front_rpy_deg=(10.0, 20.0, 30.0), front_px=(51.0, 48.0, 47.0))
    v, u = np.indices((100, 200)).astype(float)
    flipped = camera.flipped().directions(np.stack([199 - u, v], -1)) * [1, -1, 1]
    assert np.allclose(flipped, camera.directions(np.stack([u, v], -1)), equal_nan=True)
    assert camera.flipped().flipped() == camera


def picture(camera):
    """A smooth world at infinity, as a camera shows it; 0 where it shows none."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    x, y, z = np.moveaxis(camera.directions(np.stack([u, v], -1)), -1, 0)
    grey = 128 + 50 * np.sin(2 * x + 1) * np.cos(3 * y) + 40 * np.sin(4 * z + x)
    return np.nan_to_num(np.rint(grey)).astype(np.uint8)[None]


def test_a_sphere_is_stitched_as_a_camera_of_spheres_would_have_seen_it():
    camera = replace(
        side_by_side(800, 400, 200),
        front_k=(0.03, 0.0, 0.0, 0.0),
        back_rpy_deg=(3.0, -2.0, 178.0),
        back_px=(602.0, 197.0, 195.0),
    )
    sphere = EquirectangularCamera(512, 256)
    stitched = reproject(picture(camera), camera, sphere)
    assert np.abs(stitched.astype(int) - picture(sphere)).max() <= 2
    for view in ("panorama", "sphere", "mirror"):
        seen = [view_of(picture(one), one, view, False).astype(int) for one in (camera, sphere)]
        assert seen[0].shape == seen[1].shape
        assert np.median(np.abs(seen[0] - seen[1])) <= 1


@pytest.mark.slow  # it renders
def test_a_rendered_pair_of_circles_is_stitched_to_the_rendered_sphere(tmp_path):
    camera = side_by_side(400, 200, 200)
    save_camera(camera, tmp_path / "camera.json")
    seen, whole = (
        one.frames(one.plan(PathPoses(planar_poses([[-0.5, 0.2, 1.0]], [0.4]))))
        for one in (
            Calibrated(world=str(WORLD), file=str(tmp_path / "camera.json"), samples=1),
            Equirectangular(world=str(WORLD), width=192, height=96, samples=4),
        )
    )
    (pair,), (sphere,) = seen, whole
    assert pair.camera == camera
    stitched = reproject(pair.images, camera, sphere.camera, samples=4)[0].astype(int)
    off = np.abs(stitched - sphere.images[0])
    assert np.median(off) <= 2
    assert np.mean(off > 25) < 0.02  # edges of things, by the pixel


def test_its_file_and_its_mistakes(tmp_path):
    camera = side_by_side(200, 100)
    save_camera(camera, tmp_path / "camera.json")
    assert load_camera(tmp_path / "camera.json") == camera
    for settings, message in (
        ({"fov_deg": 20.0}, "fov_deg=20 is no field of view"),
        ({"front_px": (1.0, 2.0)}, "front_px holds 2 numbers; give 3"),
        ({"back_k": (-0.3, 0.0, 0.0, 0.0)}, "maps angles to radii but up to 60 degrees"),
        ({"back_px": (500.0, 2.0, 9.0)}, "the axis at .* lies outside"),
    ):
        with pytest.raises(ConfigError, match=message):
            DualFisheyeCamera(**{**vars_of(camera), **settings})


def vars_of(camera):
    return {name: getattr(camera, name) for name in type(camera).__dataclass_fields__}
