"""The camera's rays, against the law of reflection; and the deck of the robot, against where its rim is by the camera's model."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import GridPoses, PathPoses
from omnilab.cameras import HyperbolicMirror
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses
from omnilab.testing import check_sensor
from omnilab_mirror.render.rays import rays_of
from omnilab_mirror.render.tracer import BLOCK, TILE
from omnilab_mirror.sensors.mirrors import Mirror

SHARE = st.floats(0.05, 0.99)
DECK_AT_M = np.array([[0.0, 0.0, 1.0], [0.0, -0.4, 1.0], [0.0, -0.4, 1.0]])
POSES = PathPoses(planar_poses(DECK_AT_M, np.array([0.0, 0.0, 1.0])))


def meeting_point(origin, d, other_origin, e):
    """The point on origin + s d that is nearest to the ray other_origin + r e, and how far apart they pass."""
    A = np.stack([d, -e], 1)
    (s, r), *_ = np.linalg.lstsq(A, other_origin - origin, rcond=None)
    return origin + s * d, np.linalg.norm(origin + s * d - other_origin - r * e)


@given(a=st.floats(20, 80), b=st.floats(60, 240), share=SHARE, azimuth=st.floats(-np.pi, np.pi))
def test_rays_obey_the_law_of_reflection(a, b, share, azimuth):
    mirror = HyperbolicMirror(crop=1.0, a_mm=a, b_mm=b)
    ring = mirror.circle
    offset = share * ring.radius * np.array([np.cos(azimuth), np.sin(azimuth)])
    P = mirror.directions(np.array([ring.cx + offset[0], ring.cy - offset[1]]))
    c = np.hypot(a, b)
    camera, viewpoint = np.array([0, 0, -c]), np.array([0, 0, c])
    to_mirror = np.array([*(offset / mirror.pixels_per_slope), 1.0])
    Q, gap = meeting_point(camera, to_mirror, viewpoint, P)
    assert gap < 1e-6
    assert (Q[0] ** 2 + Q[1] ** 2) / a**2 - Q[2] ** 2 / b**2 == pytest.approx(-1, abs=1e-6)
    assert Q[2] > 0
    normal = np.array([Q[0] / a**2, Q[1] / a**2, -Q[2] / b**2])
    normal /= np.linalg.norm(normal)
    back = (camera - Q) / np.linalg.norm(camera - Q)
    # incident and reflected ray lie in one plane with the normal, at equal angles
    assert np.allclose(P + back, 2 * (P @ normal) * normal, atol=1e-6)


@given(u=st.floats(0, 249), v=st.floats(0, 249), crop=st.sampled_from([0.5, 0.8]))
def test_pixel_to_direction_to_pixel(u, v, crop):
    camera = HyperbolicMirror(crop=crop)
    direction = camera.directions(np.array([u, v]))
    if np.isfinite(direction).all():
        assert np.allclose(camera.pixels(3.7 * direction), [u, v], atol=1e-6)


@pytest.mark.parametrize(("crop", "size"), [(0.5, 60), (1.0, 61), (1.0, 8)])
def test_cones_hold_the_rays_of_their_pixels(crop, size):
    rays, _, blocks, tiles = rays_of(HyperbolicMirror(size=size, crop=crop), samples=4)
    for cones, side in ((blocks, BLOCK), (tiles, TILE)):
        for v, u in np.ndindex(size, size):
            cos, sin = cones.spread[v // side, u // side]
            d = rays[v, u, :, :3]
            d = d[np.any(d != 0, axis=1)]
            assert np.all(d @ cones.axis[v // side, u // side] >= cos - 1e-8)
            assert cos < -1 or cos**2 + sin**2 == pytest.approx(1)


def test_solid_angles_fill_the_cap_that_the_mirror_shows():
    camera = HyperbolicMirror(size=200, crop=1.0)
    edge = camera.directions(np.array([camera.center + camera.circle.radius - 1e-6, camera.center]))
    rays = rays_of(camera, samples=4).rays
    assert rays[..., 3].sum() / 4 == pytest.approx(2 * np.pi * (1 + edge[2]), rel=0.01)


def imaged(**settings):
    sensor = Mirror(size=120, samples=4, **settings)
    return next(iter(sensor.frames(sensor.plan(POSES))))


def radii(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.hypot(u - (camera.width - 1) / 2, v - (camera.height - 1) / 2)


@pytest.mark.parametrize(("radius_m", "below_m"), [(0.25, 0.72), (0.5, 0.72), (0.25, 0.4)])
def test_the_deck_is_within_its_rim_and_the_room_outside(radius_m, below_m):
    without, found = imaged(), imaged(deck_radius_m=radius_m, deck_below_m=below_m)
    rim = np.arctan(radius_m / below_m)  # from straight down
    u, _ = found.camera.pixels(np.array([np.sin(rim), 0, -np.cos(rim)]))
    from_middle = radii(found.camera)
    edge = u - (found.camera.width - 1) / 2
    inside, outside = from_middle < edge - 1, from_middle > edge + 1
    assert inside.sum() > 50
    np.testing.assert_array_equal(found.images[:, outside], without.images[:, outside])
    for image in found.images[1:]:  # other places, another heading
        np.testing.assert_array_equal(image[inside], found.images[0][inside])
    assert np.ptp(found.images[0][inside].astype(int)) > 100  # something stands on it


def test_twice_as_large_and_twice_as_far_below_looks_the_same():
    one, other = (imaged(deck_radius_m=k * 0.25, deck_below_m=k * 0.5, color=True) for k in (1, 2))
    np.testing.assert_array_equal(one.images, other.images)
    grey = imaged(deck_radius_m=0.25, deck_below_m=0.5)
    inside = radii(grey.camera) < 5
    assert (one.images[0][inside] == grey.images[0][inside][:, None]).all()


def test_images_of_other_decks_have_other_keys():
    keys = [imaged(**s).keys[0] for s in ({}, {"deck_below_m": 0.5}, {"deck_radius_m": 0.25}, {"deck_radius_m": 0.3})]
    assert keys[0] == keys[1]  # no deck, wherever
    assert len(set(keys)) == 3


def test_the_contract_with_a_deck():
    check_sensor(Mirror(size=64, samples=1, deck_radius_m=0.3), GridPoses(2.0))


def test_a_deck_without_a_depth():
    with pytest.raises(ConfigError, match=r"give sensor.deck_radius_m=0, or sensor.depth=false"):
        Mirror(deck_radius_m=0.25, depth=True)
    with pytest.raises(ConfigError, match="deck_below_m=0 is out of range"):
        Mirror(deck_below_m=0)
