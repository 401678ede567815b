"""Reprojection against pictures that are painted directly: smooth functions of the direction seen."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.cameras import (
    CylindricalCamera,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    ParabolicMirror,
    PinholeCamera,
    birds_eye,
    reproject,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import rotation_xyz

CAMERAS = {
    "mirror": HyperbolicMirror(180, crop=0.8),
    "parabola": ParabolicMirror(180),
    "sphere": EquirectangularCamera(240, 120, start_deg=20, clockwise=True),
    "cylinder": CylindricalCamera(256, 100, lowest_deg=-50, highest_deg=40),
    "pinhole": PinholeCamera(width=150, height=110, cx=75.2, cy=54.1, focal_px=55, looks="ahead"),
    "fisheye": FisheyeCamera(width=170, height=170, cx=84.5, cy=84.5, focal_px=60, looks="down"),
    "bird": birds_eye(120, 0.03, 1.0),
}
PAIRS = list(itertools.product(CAMERAS, repeat=2))
angles = st.floats(-np.pi, np.pi)


def grid_of(camera):
    v, u = np.indices((camera.height, camera.width))
    return np.stack([u, v], -1).astype(float)


def painted(camera, R_world_camera, channels=()):
    """Grey levels 30 to 230 that vary smoothly with the direction in the world; 0 where the camera sees nothing."""
    d = camera.directions(grid_of(camera)) @ R_world_camera.T
    levels = [130 + 60 * np.sin(2 * d @ axis) + 40 * np.cos(3 * d[..., 2]) for axis in np.eye(3)[: sum(channels) or 1]]
    picture = np.stack(levels, -1) if channels else levels[0]
    return np.nan_to_num(np.rint(picture)).astype(np.uint8)


def whole(camera, pixels):
    """Pixels whose four neighbours the camera shows, all of which are painted."""
    last = np.array([camera.width, camera.height]) - 1
    corners = [np.clip(np.floor(pixels) + corner, 0, last) for corner in itertools.product((0, 1), repeat=2)]
    seen = np.isfinite(pixels).all(-1) & (pixels >= -0.5).all(-1) & (pixels <= last + 0.5).all(-1)
    return seen & np.all([np.isfinite(camera.directions(np.nan_to_num(c))).all(-1) for c in corners], axis=0)


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_a_reprojected_picture_is_the_one_the_target_takes(source, target):
    source, target = CAMERAS[source], CAMERAS[target]
    R_world_source, R_source_target = rotation_xyz(0.1, -0.2, 0.5), rotation_xyz(-0.3, 0.25, 1.3)
    (found,) = reproject(painted(source, R_world_source)[None], source, target, R_source_target)
    direct = painted(target, R_world_source @ R_source_target)
    pixels = source.pixels(target.directions(grid_of(target)) @ R_source_target.T)
    seen = whole(source, pixels)
    assert seen.mean() > 0.01
    assert np.abs(found.astype(int) - direct)[seen].max() <= 3
    unseen = np.isnan(pixels).any(-1)
    assert not found[unseen].any()


@given(angles, angles, angles)
def test_any_turn_and_back_is_the_same_sphere(x, y, z):
    sphere, R = EquirectangularCamera(200, 100), rotation_xyz(x, y, z)
    first = painted(sphere, np.eye(3))[None]
    turned = reproject(first, sphere, sphere, R)
    assert np.abs(turned[0].astype(int) - painted(sphere, R)).max() <= 2
    assert np.abs(reproject(turned, sphere, sphere, R.T).astype(int) - first).max() <= 3


@given(angles)
def test_a_turn_about_the_axis_shifts_a_panorama_across_its_seam(start):
    here, there = CylindricalCamera(128, 40), CylindricalCamera(128, 40, start_deg=float(np.rad2deg(start)))
    (found,) = reproject(painted(here, np.eye(3))[None], here, there)
    assert np.abs(found.astype(int) - painted(there, np.eye(3))).max() <= 2


def test_a_batch_equals_its_images_one_by_one_in_grey_and_color():
    source, target = CAMERAS["mirror"], CAMERAS["cylinder"]
    turns = [rotation_xyz(0, 0, k) for k in range(3)]
    color = np.stack([painted(source, R, (3,)) for R in turns])
    together = reproject(color, source, target, samples=4)
    assert together.shape == (3, target.height, target.width, 3)
    assert np.array_equal(together, np.concatenate([reproject(i[None], source, target, samples=4) for i in color]))
    channels = [reproject(color[..., c], source, target, samples=4) for c in range(3)]
    assert np.array_equal(together, np.stack(channels, -1))


def test_samples_average_what_a_coarse_target_would_alias():
    """Stripes of two columns each, seen by a sphere eight times coarser: every pixel covers two pairs of them."""
    fine, coarse = EquirectangularCamera(512, 256), EquirectangularCamera(64, 32)
    stripes = np.zeros((1, 256, 512), np.uint8)
    stripes[:, :, ::2] = 200
    assert np.abs(reproject(stripes, fine, coarse, samples=64).astype(int) - 100).max() <= 1


def test_samples_that_are_not_seen_do_not_darken_the_edge():
    source, target = CAMERAS["pinhole"], CAMERAS["sphere"]
    white = np.full((1, source.height, source.width), 200, np.uint8)
    assert set(np.unique(reproject(white, source, target, samples=9))) == {0, 200}


def test_a_point_found_in_a_panorama_is_put_back_on_the_sphere():
    """A bright spot is imaged by the mirror, found in its panorama, and its direction is the one it was painted at."""
    mirror, panorama = HyperbolicMirror(500, crop=0.8), CylindricalCamera(1024, 400, lowest_deg=-50, highest_deg=30)
    spot = np.array([0.6, -0.7, -0.3]) / np.linalg.norm([0.6, -0.7, -0.3])
    glow = 255 * np.exp(-((1 - mirror.directions(grid_of(mirror)) @ spot) / 3e-4))
    image = np.nan_to_num(glow).astype(np.uint8)[None]
    (wide,) = reproject(image, mirror, panorama)
    weight = np.where(wide > 100, wide, 0).astype(float)
    found = panorama.directions((weight[..., None] * grid_of(panorama)).sum((0, 1)) / weight.sum())
    assert np.rad2deg(np.arccos(found @ spot)) < 0.1


@given(st.floats(0.005, 0.1), st.floats(0.2, 3), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_the_birds_eye_view_has_one_scale_on_the_floor(metres_per_px, height, right, up):
    bird = birds_eye(201, metres_per_px, height)
    x, y = metres_per_px * 100 * np.array([right, up])
    assert np.allclose(bird.pixels(np.array([x, y, -height])), [100 + 100 * right, 100 - 100 * up])


@pytest.mark.parametrize(
    ("call", "fix"),
    [
        (lambda m: reproject(np.zeros((1, 20, 30), np.uint8), m, m), r"\(1, 20, 30\).*180 x 180.*\(N, 180, 180\)"),
        (lambda m: reproject(np.zeros((180, 180), np.uint8), m, m), r"\(180, 180\).*give \(N, 180"),
        (lambda m: reproject(np.zeros((1, 180, 180), np.uint8), m, m, samples=3), "samples=3.*give 1, 4, 9"),
        (
            lambda m: reproject(np.zeros((1, 180, 180), np.uint8), m, CylindricalCamera(40000, 10)),
            "40000 pixels.*at most",
        ),
        (lambda m: birds_eye(100, 0.0, 1.0), "metres_per_px=0.0.*above 0"),
        (lambda m: birds_eye(100, 0.1, float("nan")), "height_m=nan.*above 0"),
    ],
)
def test_what_cannot_be_reprojected_is_said(call, fix):
    with pytest.raises((ConfigError, DataError), match=fix):
        call(CAMERAS["mirror"])
