"""Camera models against the physics of the mirror; views against exact turns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Circle
from omnilab.cameras import HyperbolicMirror, ImageCircle, PinholeCamera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import poses, rotation_xyz
from omnilab.image import encode, mirror_view, panorama, point_cloud, to_gray, view_of

mirrors = st.builds(
    HyperbolicMirror,
    size=st.integers(32, 600),
    crop=st.floats(0.2, 1.0),
    a_mm=st.floats(10, 80),
    b_mm=st.floats(40, 200),
    rim_mm=st.floats(10, 60),
)


@given(mirrors, st.floats(0.01, 0.999), st.floats(0, 2 * np.pi))
def test_rays_reflect_at_the_mirror(mirror, share, azimuth):
    """Angle of incidence = angle of reflection where the camera's ray meets the hyperboloid."""
    pixel = mirror.center + share * mirror.size / 2 * np.array([np.cos(azimuth), -np.sin(azimuth)])
    direction = mirror.directions(pixel)
    focus, viewpoint = np.array([0, 0, -mirror.c_mm]), np.array([0, 0, mirror.c_mm])
    # the point of the mirror seen at this pixel lies on the line through the viewpoint, at distance |QF| - 2b
    along = mirror.a_mm**2 / (mirror.b_mm - mirror.c_mm * direction[2])
    Q = viewpoint + along * direction
    assert np.isclose((Q[0] ** 2 + Q[1] ** 2) / mirror.a_mm**2 - Q[2] ** 2 / mirror.b_mm**2, -1, atol=1e-7)
    normal = np.array([Q[0] / mirror.a_mm**2, Q[1] / mirror.a_mm**2, -Q[2] / mirror.b_mm**2])
    normal /= np.linalg.norm(normal)
    incoming = (Q - focus) / np.linalg.norm(Q - focus)
    reflected = incoming - 2 * (incoming @ normal) * normal
    assert np.allclose(reflected, direction, atol=1e-7)


@given(mirrors, st.integers(0, 2**32 - 1))
def test_pixels_and_directions_are_inverse(mirror, seed):
    rng = np.random.default_rng(seed)
    radius = 0.999 * min(mirror.size / 2, mirror.circle.radius) * np.sqrt(rng.random(50))
    azimuth = rng.uniform(0, 2 * np.pi, 50)
    pixels = mirror.center + radius[:, None] * np.stack([np.cos(azimuth), -np.sin(azimuth)], -1)
    assert np.allclose(mirror.pixels(mirror.directions(pixels)), pixels, atol=1e-6)


def test_the_thesis_mirror_looks_where_the_thesis_says():
    half, whole = HyperbolicMirror(crop=0.5), HyperbolicMirror(crop=1.0)
    assert np.isclose(np.rad2deg(half.highest_rad), 17.5, atol=0.5)
    assert np.isclose(np.rad2deg(whole.highest_rad), 49.7, atol=0.5)
    horizon = np.array([1.0, 0, 0])
    assert np.isclose(half.pixels(horizon)[0] - half.center, 91, atol=0.5)
    assert np.isclose(whole.pixels(horizon)[0] - whole.center, 45, atol=0.7)
    assert np.allclose(half.directions(np.array([half.center, half.center])), [0, 0, -1])


def test_what_the_mirror_does_not_show_has_no_pixel():
    whole = HyperbolicMirror(crop=1.0)
    assert np.isnan(whole.pixels(np.array([0, 0, 1.0]))).all()
    assert np.isnan(whole.directions(np.array([0.0, 0.0]))).all()  # a corner, beyond the rim


def test_azimuth_grows_counter_clockwise_from_image_right():
    mirror = HyperbolicMirror()
    right, up = mirror.pixels(np.array([[1.0, 0, 0], [0, 1.0, 0]]))
    assert right[0] > mirror.center
    assert np.isclose(right[1], mirror.center)
    assert up[1] < mirror.center
    assert np.isclose(up[0], mirror.center)


@pytest.mark.parametrize("settings", [{"size": 4}, {"crop": 0.0}, {"crop": 1.5}, {"a_mm": -1.0}])
def test_impossible_mirrors_are_refused(settings):
    with pytest.raises(ConfigError, match=r"\d"):
        HyperbolicMirror(**settings)


def _spotted(azimuth: float, radius: float) -> np.ndarray:
    image = np.zeros((1, 101, 101), np.uint8)
    u, v = 50 + radius * np.cos(azimuth), 50 - radius * np.sin(azimuth)
    image[0, round(v), round(u)] = 255
    return image


@pytest.mark.parametrize("azimuth_deg", [0, 37, 90, 200, 315])
@pytest.mark.parametrize("sky_inside", [False, True])
def test_a_spot_lands_in_its_column_and_row_of_the_panorama(azimuth_deg, sky_inside):
    camera = ImageCircle(101, 101, Circle(50, 50, 50, 10), sky_inside)
    wide = panorama(_spotted(np.deg2rad(azimuth_deg), 40), camera, (40, 360))[0]
    row, column = np.unravel_index(wide.argmax(), wide.shape)
    assert abs((column - azimuth_deg + 180) % 360 - 180) <= 2
    outer = row < 20  # radius 40 of 10..50 lies in the outer half, which is up unless the sky is inside
    assert outer != sky_inside


@given(st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_quarter_turns_of_the_image_shift_the_panorama(quarter, seed):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 255, (1, 64, 64), dtype=np.uint8)
    camera = ImageCircle(64, 64, Circle(31.5, 31.5, 31, 4))
    turned = np.rot90(image, quarter, axes=(1, 2))  # counter-clockwise
    before, after = panorama(image, camera, (16, 64))[0], panorama(turned, camera, (16, 64))[0]
    assert np.abs(np.roll(before, 16 * quarter, axis=1).astype(int) - after).max() <= 2


def test_the_mirror_view_is_the_square_around_the_circle():
    image = np.arange(60 * 80, dtype=np.uint8).reshape(1, 60, 80)
    camera = ImageCircle(80, 60, Circle(39.5, 29.5, 20))
    assert np.array_equal(mirror_view(image, camera), image[:, 10:50, 20:60])
    with pytest.raises(DataError, match="radius 20"):
        mirror_view(image, ImageCircle(80, 60, Circle(-10, 29.5, 20)))


def test_views_are_grey_or_rgb_as_asked():
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (2, 32, 32, 3), dtype=np.uint8)
    camera = ImageCircle(32, 32, Circle(15.5, 15.5, 16))
    luma = rgb @ np.array([0.299, 0.587, 0.114])
    assert np.abs(to_gray(rgb) - luma).max() <= 1
    assert view_of(rgb, camera, "mirror", color=False).shape == (2, 32, 32)
    assert view_of(rgb[..., 0], camera, "mirror", color=True).shape == (2, 32, 32, 3)
    assert view_of(rgb, camera, "panorama", color=True).shape[-1] == 3
    with pytest.raises(ConfigError, match="polar"):
        view_of(rgb, camera, "polar", color=False)


def test_encoded_pictures_read_back():
    from io import BytesIO

    from skimage.io import imread  # not the library that wrote them

    rgb = np.random.default_rng(1).integers(0, 255, (20, 30, 3), dtype=np.uint8)
    assert np.array_equal(imread(BytesIO(encode(rgb, "png"))), rgb)


def test_a_point_cloud_lies_where_the_camera_saw_it():
    camera = PinholeCamera(width=32, height=24, cx=15.5, cy=11.5, focal_px=20)
    T = poses([1, 2, 3], rotation_xyz(0.2, -0.1, 0.7))[0]
    depth = np.full((24, 32), 2.0)
    depth[3, 4] = np.inf
    points = point_cloud(depth, camera, T)
    assert np.isnan(points[3, 4]).all()
    seen = np.isfinite(depth)
    assert np.allclose(np.linalg.norm(points[seen] - T[:3, 3], axis=-1), 2)
    v, u = np.nonzero(seen)
    assert np.allclose(camera.project((points[seen] - T[:3, 3]) @ T[:3, :3]), np.stack([u, v], -1))
