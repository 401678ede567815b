"""Every virtual camera in the room, rays that start around the viewpoint, depth, and the sky."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import omnilab_mirror
from omnilab.api import PathPoses, RandomPoses
from omnilab.cameras import (
    ConicalMirror,
    EquirectangularCamera,
    HyperbolicMirror,
    PinholeCamera,
    SphericalMirror,
    StereoCamera,
    save_camera,
)
from omnilab.errors import DataError
from omnilab.geometry import planar_poses, rotation_xyz
from omnilab.image import panorama, point_cloud
from omnilab.testing import check_sensor
from omnilab_mirror.render.render import depth_of, render
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.quads import Quad
from omnilab_mirror.scene.textures.canvas import Paint
from omnilab_mirror.scene.world import World

OCAM = """#polynomial coefficients for the DIRECT mapping function
4 -40.0 0.0 0.004 0.00001

#polynomial coefficients for the inverse mapping function
2 60.0 30.0

#center: "row" and "column"
40.0 41.0

#affine parameters "c", "d", "e"
1.0 0.0 0.0

#image size: "height" and "width"
80 82
"""
SMALL = {
    "Mirror": {"size": 48},
    "Parabolic": {"size": 48},
    "Spherical": {"size": 48},
    "Elliptic": {"size": 48},
    "Conical": {"size": 48},
    "Unified": {"width": 64, "height": 48, "fx": 10.0, "fy": 10.0, "cx": 31.5, "cy": 23.5, "k1": -0.01, "rim_px": 24.0},
    "Fisheye": {"size": 48, "focal_px": 15.0},
    "KannalaBrandt": {"width": 48, "height": 48, "fx": 15.0, "fy": 15.5, "cx": 23.5, "cy": 23.5, "rim_px": 24.0},
    "BrownConrady": {"width": 64, "height": 48, "fx": 40.0, "fy": 40.0, "cx": 31.5, "cy": 23.5},
    "Pinhole": {"width": 64, "height": 48, "focal_px": 40.0},
    "Stereo": {"width": 96, "height": 48, "focal_px": 40.0},
    "Cylindrical": {"width": 96, "height": 32},
    "Equirectangular": {"width": 96, "height": 48},
    "OCam": {},
    "Calibrated": {},
}


@pytest.fixture
def sensor_of(tmp_path):
    """Makes a sensor by name, small; those that need a file get one."""
    (tmp_path / "calib_results.txt").write_text(OCAM)
    save_camera(SphericalMirror(size=40), tmp_path / "camera.json")
    files = {"OCam": "calib_results.txt", "Calibrated": "camera.json"}

    def sensor_of(name: str, **settings):
        file = {"file": str(tmp_path / files[name])} if name in files else {}
        return getattr(omnilab_mirror, name)(**SMALL[name] | file | settings)

    return sensor_of


def painted(color) -> Paint:
    return Paint(lambda canvas: canvas.filled(color))


def world_of(faces, sky=None) -> World:
    return World("test", (8, 6), faces, [], None, Illumination(1.0, []), 8, 0, sky)


def box(x, y, z) -> World:
    """The inside of a box around the origin, from floor 0 to z."""
    corners = [
        ((-x, -y, 0), (2 * x, 0, 0), (0, 2 * y, 0)),
        ((-x, y, z), (2 * x, 0, 0), (0, -2 * y, 0)),
        ((-x, y, 0), (2 * x, 0, 0), (0, 0, z)),
        ((x, -y, 0), (-2 * x, 0, 0), (0, 0, z)),
        ((x, y, 0), (0, -2 * y, 0), (0, 0, z)),
        ((-x, -y, 0), (0, 2 * y, 0), (0, 0, z)),
    ]
    return world_of([Quad(*map(np.array, map(np.float64, face)), painted([90, 120, 150])) for face in corners])


def centers(camera):
    """The pixels (H, W, 2) of a camera."""
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.stack([u, v], -1).astype(float)


def pictures(sensor, T_world_camera):
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(PathPoses(T_world_camera)))])


# --------------------------------------------------------------------------------------------------------- the sensors
def test_every_sensor_of_the_plugin_is_tried():
    assert set(SMALL) == set(omnilab_mirror.__all__)


@pytest.mark.parametrize("name", SMALL)
def test_every_camera_keeps_the_contract_and_sees_the_room(name, sensor_of):
    sensor = sensor_of(name, batch=2)
    check_sensor(sensor, RandomPoses(3, seed=4))
    image = next(sensor.frames(sensor.plan(RandomPoses(1, seed=4)))).images[0]
    shown = np.isfinite(sensor.camera.directions(centers(sensor.camera))[..., 0])
    assert shown.mean() > 0.5
    assert image[shown].min() > 0  # the room has no holes
    assert image[shown].std() > 10


@pytest.mark.parametrize("name", ["Parabolic", "Elliptic", "Pinhole", "Equirectangular"])
def test_another_camera_has_other_keys(name, sensor_of):
    layout = RandomPoses(2, seed=0)
    keys = list(sensor_of(name).plan(layout).keys)
    assert keys == list(sensor_of(name, depth=True, batch=1).plan(layout).keys)
    assert not set(keys) & set(sensor_of("Mirror").plan(layout).keys)


def test_a_missing_calibration_is_said(tmp_path):
    with pytest.raises(DataError, match=r"absent\.txt cannot be read"):
        omnilab_mirror.OCam(file=str(tmp_path / "absent.txt"))
    with pytest.raises(DataError, match=r"absent\.json cannot be read"):
        omnilab_mirror.Calibrated(file=str(tmp_path / "absent.json"))


# ------------------------------------------------------------------------------------ rays that start around the viewpoint
def brute_force(faces, T, origins, directions):
    """Index of the nearest face (...,) along each ray (-1: none), how far it is, and whether that is beyond doubt."""
    best = np.full(directions.shape[:-1], np.inf)
    index, sure = np.full(best.shape, -1), np.ones(best.shape, bool)
    world, start = directions @ T[:3, :3].T, origins @ T[:3, :3].T + T[:3, 3]
    for i, face in enumerate(faces):
        A = np.stack([world, np.broadcast_to(-face.u, world.shape), np.broadcast_to(-face.v, world.shape)], -1)
        t, x, y = np.moveaxis(np.linalg.solve(A, (face.corner - start)[..., None])[..., 0], -1, 0)
        margin = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
        sure &= (np.abs(margin) > 1e-6) & ((np.abs(t - best) > 1e-6) | (t < 0)) & (np.abs(t) > 1e-6)
        nearer = (t > 0) & (margin > 0) & (t < best)
        best, index = np.where(nearer, t, best), np.where(nearer, i, index)
    return index, best, sure


around = st.one_of(
    st.builds(SphericalMirror, size=st.just(50), crop=st.sampled_from([0.5, 1.0])),
    # metres across, so that rays start well away from the viewpoint
    st.builds(
        lambda scale: SphericalMirror(50, distance_mm=100 * scale, rim_radius_mm=35 * scale, radius_mm=40 * scale),
        st.floats(1, 40),
    ),
    st.builds(ConicalMirror, size=st.just(50), rim_radius_mm=st.floats(30, 1500)),
    st.builds(
        lambda baseline: StereoCamera(width=100, height=40, focal_px=25, baseline_m=baseline), st.floats(0.01, 3)
    ),
)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(camera=around, seed=st.integers(0, 10**6), count=st.integers(1, 50))
def test_rays_around_a_viewpoint_hit_what_brute_force_hits(camera, seed, count):
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-1.5, 1, (count, 1))
    corner, u, v = rng.normal(size=(count, 3)) * 2, *(rng.normal(size=(2, count, 3)) * scale)
    faces = [Quad(corner[i], u[i], v[i], painted([i + 1, 0, 255 - i])) for i in range(count)]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    image = render(world_of(faces), camera, T[None], samples=1, color=True)[0]
    depth = depth_of(world_of(faces), camera, T[None])[0]
    o, d = camera.origins(centers(camera)), camera.directions(centers(camera))
    seen = np.isfinite(d[..., 0])
    index, far, sure = brute_force(faces, T, np.nan_to_num(o), np.nan_to_num(d, nan=1.0))
    assert sure[seen].mean() > 0.9
    assert np.array_equal(image[..., 0][sure & seen], (index + 1)[sure & seen])
    assert (image[~seen] == 0).all()
    assert np.allclose(depth[sure & seen], far[sure & seen], rtol=1e-5)
    assert np.isinf(depth[~seen]).all()


def test_a_face_in_whose_plane_the_viewpoint_lies_is_seen_by_rays_around_it():
    """A table top at the height of a ball's lowest point: rays start above it and look down on it."""
    table = Quad(np.array([0.06, -1, 1]), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]), painted([200, 200, 200]))
    camera = SphericalMirror(size=501)
    image = render(world_of([table]), camera, planar_poses([0, 0, 1.0]), 1, color=False)[0]
    near, far = camera.project(np.array([[0.06, 0, 0], [1.9, 0, 0]]))
    assert near[0] + 6 < far[0]
    assert image[250, round(near[0]) + 2 : round(far[0])].min() == 200
    assert image[250, : round(near[0]) - 2].max() == 0


@pytest.mark.slow
def test_a_ball_sees_corners_where_its_model_says():
    dots = np.array([[0.4, 0.1, 0.8], [-0.3, 0.4, 1.05], [0.1, -0.25, 0.9]])  # so near that the rays' starts matter
    side = 0.02
    camera, T = SphericalMirror(size=300), planar_poses([0, 0, 1.0], 0.6)
    for dot in dots:
        toward = np.array([0, 0, 1.0]) - dot
        u = np.cross(toward, [0, 0, 1.0])
        u *= side / np.linalg.norm(u)
        v = np.cross(u, toward)
        v *= side / np.linalg.norm(v)
        image = render(world_of([Quad(dot - (u + v) / 2, u, v, painted([255] * 3))]), camera, T, 16, color=False)[0]
        v_px, u_px = np.nonzero(image)
        weights = image[v_px, u_px]
        found = np.average(u_px, weights=weights), np.average(v_px, weights=weights)
        local = (dot - T[0, :3, 3]) @ T[0, :3, :3]
        assert np.allclose(found, camera.project(local), atol=0.15)
        assert np.abs(camera.project(local) - camera.pixels(local)).max() > 0.5  # it has no viewpoint


def test_a_stereo_picture_is_two_pictures():
    T = planar_poses([0.5, -1, 1], 0.4)
    both = pictures(omnilab_mirror.Stereo(width=200, height=80, focal_px=60, baseline_m=0.2), T)[0]
    aside = T[0, :3, 1] * 0.1
    for half, sign in ((both[:, :100], 1), (both[:, 100:], -1)):
        shifted = T.copy()
        shifted[0, :3, 3] += sign * aside
        alone = pictures(omnilab_mirror.Pinhole(width=100, height=80, focal_px=60), shifted)[0]
        assert (np.abs(half.astype(int) - alone) > 1).mean() < 1e-3  # rays on a face's edge may fall to either side


# --------------------------------------------------------------------------------------------------------------- depth
@pytest.mark.parametrize("camera", [
    HyperbolicMirror(size=60, crop=1.0), SphericalMirror(size=60), ConicalMirror(size=61),
    PinholeCamera(width=60, height=40, cx=29.5, cy=19.5, focal_px=30),
    StereoCamera(width=80, height=40, focal_px=30, baseline_m=0.3), EquirectangularCamera(64, 32),
], ids=lambda camera: type(camera).__name__)  # fmt: skip
def test_depth_in_a_box_is_the_distance_to_its_walls(camera):
    T = planar_poses([0.4, -0.3, 1.2], 0.5)
    T[0, :3, :3] = T[0, :3, :3] @ rotation_xyz(0.1, -0.2, 0.3)
    depth = depth_of(box(2, 1.5, 2.5), camera, T)[0]
    shown = np.isfinite(camera.directions(centers(camera))[..., 0])
    assert depth.dtype == np.float32
    assert np.array_equal(np.isfinite(depth), shown)
    d = camera.directions(centers(camera))[shown] @ T[0, :3, :3].T
    o = camera.origins(centers(camera))[shown] @ T[0, :3, :3].T + T[0, :3, 3]
    with np.errstate(divide="ignore"):
        walls = np.maximum(([-2, -1.5, 0] - o) / d, ([2, 1.5, 2.5] - o) / d)  # slabs (Kay & Kajiya, 1986)
    assert np.allclose(depth[shown], walls.min(-1), rtol=1e-5)
    points = point_cloud(depth, camera, T[0])[shown]
    off = np.abs(points[None] - np.array([[[-2, -1.5, 0]], [[2, 1.5, 2.5]]])).min((0, 2))
    assert off.max() < 1e-5


def test_depth_comes_with_the_images_that_are_the_same_without_it():
    layout = RandomPoses(3, seed=1)
    without, deep = omnilab_mirror.Mirror(size=64), omnilab_mirror.Mirror(size=64, depth=True, batch=2, samples=9)
    assert next(without.frames(without.plan(layout))).depth_m is None
    frames = list(deep.frames(deep.plan(layout)))
    assert [f.depth_m.shape for f in frames] == [(2, 64, 64), (1, 64, 64)]
    whole = next(omnilab_mirror.Mirror(size=64, samples=9).frames(deep.plan(layout)))
    assert np.array_equal(np.concatenate([f.images for f in frames]), whole.images)
    assert min(f.depth_m.min() for f in frames) > 0.05


# ----------------------------------------------------------------------------------------------------------------- sky
FAR_BELOW = Quad(np.array([-1.0, -1, -50]), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]), painted([0, 0, 0]))


def smooth_sky(width=512, height=256):
    """Its colours are linear in the direction: red along x, green along y, blue along z."""
    d = EquirectangularCamera(width, height).directions(np.stack(np.meshgrid(range(width), range(height)), -1))
    return np.rint(127.5 + 120 * d).astype(np.uint8)


@pytest.mark.parametrize("camera", [HyperbolicMirror(size=100), SphericalMirror(size=100),
    EquirectangularCamera(256, 128), PinholeCamera(width=60, height=60, cx=29.5, cy=29.5, focal_px=30, looks="up"),
], ids=lambda camera: type(camera).__name__)  # fmt: skip
def test_past_all_faces_is_the_sky_where_the_world_has_it(camera):
    T = planar_poses([3, -5, 1.0], 2.0)
    T[0, :3, :3] = T[0, :3, :3] @ rotation_xyz(0.3, 0.2, -1)
    image = render(world_of([FAR_BELOW], smooth_sky()), camera, T, 1, color=True)[0]
    d = camera.directions(centers(camera))
    shown = np.isfinite(d[..., 0])
    expected = 127.5 + 120 * d[shown] @ T[0, :3, :3].T
    difference = np.abs(image[shown] - expected)
    assert difference.mean() < 1.5
    assert np.percentile(difference, 99.9) < 8  # straight below is the far face, and the poles are coarse
    assert (image[~shown] == 0).all()


def test_the_sky_has_no_seam_and_is_filtered():
    rng = np.random.default_rng(0)
    noise = np.where(rng.random((512, 1024, 1)) < 0.5, 0, 255).repeat(3, -1).astype(np.uint8)
    camera = EquirectangularCamera(64, 32)
    image = render(world_of([FAR_BELOW], noise), camera, planar_poses([0, 0, 0.0]), 1, color=False)[0][2:-2]
    assert image.mean() == pytest.approx(127.5, abs=2)
    assert image.std() < 25
    smooth = render(world_of([FAR_BELOW], smooth_sky()), EquirectangularCamera(512, 64),
                    planar_poses([0, 0, 0.0], 0.003), 1, color=True)[0].astype(int)  # fmt: skip
    jump = np.abs(smooth[8:-8, 0] - smooth[8:-8, -1]).max()
    assert jump <= np.abs(np.diff(smooth[8:-8], axis=1)).max() + 1


def test_without_a_sky_past_all_faces_is_black():
    assert render(world_of([FAR_BELOW]), HyperbolicMirror(size=64), planar_poses([9, 9, 1.0]), 1, False).max() == 0


# ------------------------------------------------------------------------------------------- pictures against each other
def away_from_edges(picture):
    """Where a panorama (H, W) is smooth over five pixels."""
    wide = np.pad(picture, ((0, 0), (4, 4)), mode="wrap")
    return (cv2.morphologyEx(wide, cv2.MORPH_GRADIENT, np.ones((5, 5))) < 20)[:, 4:-4]


def coarse(panorama_of, factor=4):
    """A panorama (H, W) with the pixels of squares averaged, so that both of a pair are filtered alike."""
    height, width = panorama_of.shape
    return cv2.resize(panorama_of.astype(np.float32), (width // factor, height // factor), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize(
    ("name", "count"),
    [("Mirror", 1), *(pytest.param(name, 2, marks=pytest.mark.slow) for name in ("Mirror", "Parabolic"))],
)
def test_the_unwrapped_mirror_image_is_the_panorama_rendered_directly(name, count):
    """Mirror images of 700 x 700 and panoramas of 256 x 1024, compared at 64 x 256."""
    T = planar_poses([[0.5, -1, 1], [-2, 1.5, 1]], [0.4, 2])[:count]
    sensor = getattr(omnilab_mirror, name)(size=700, crop=1.0)
    lowest, highest = np.rad2deg(sensor.camera.elevations_rad)
    sphere = omnilab_mirror.Equirectangular(
        width=1024,
        height=256,
        lowest_deg=max(lowest, -60),
        highest_deg=min(highest, 60),
        start_deg=0,
        clockwise=False,
    )
    unwrapped = panorama(pictures(sensor, T), sensor.camera, (256, 1024))
    for one, other in zip(map(coarse, pictures(sphere, T)), map(coarse, unwrapped), strict=True):
        difference, smooth = np.abs(one - other), away_from_edges(one)
        assert smooth.mean() > 0.1
        assert difference.mean() <= 2.5
        assert difference[smooth].mean() <= 0.5
        assert np.abs(one - other[:, ::-1]).mean() > 10  # and mirrored it is another


@pytest.mark.parametrize("name", ["Spherical", "Conical"])
def test_turning_a_camera_without_a_viewpoint_turns_its_image(name):
    sensor, turn, at = getattr(omnilab_mirror, name)(size=500), -1.234, [0.5, -1.0, 1.0]
    zero, turned = pictures(sensor, planar_poses([at, at], [0, turn])).astype(np.float32)
    rotation = cv2.getRotationMatrix2D((249.5, 249.5), -np.rad2deg(turn), 1)
    expected = cv2.warpAffine(zero, rotation, zero.shape, flags=cv2.INTER_CUBIC)
    v, u = np.mgrid[:500, :500]
    radius = np.hypot(u - 249.5, v - 249.5)
    inside = (radius > 40) & (radius < 245)  # around the tip of the cone a pixel sees many azimuths
    difference = np.abs(expected - turned)
    smooth = cv2.morphologyEx(turned, cv2.MORPH_GRADIENT, np.ones((5, 5))) < 20
    assert difference[inside].mean() <= 2.5
    assert difference[inside & smooth].mean() <= 0.5


@pytest.mark.slow
def test_the_rays_of_a_tiny_ball_might_as_well_start_in_one_point():
    rng = np.random.default_rng(5)
    faces = [Quad(rng.normal(size=3) * 3, *(rng.normal(size=(2, 3)) * 1.5), painted([60 + 9 * i] * 3))
             for i in range(20)]  # fmt: skip
    ball = SphericalMirror(size=400, distance_mm=0.1, rim_radius_mm=0.035, radius_mm=0.04)
    T = planar_poses([0, 0, 0.0], 0.3)
    direct = render(world_of(faces), EquirectangularCamera(256, 64, lowest_deg=-60,
        highest_deg=float(np.rad2deg(ball.elevations_rad[1]))), T, 16, False)[0]  # fmt: skip
    unwrapped = panorama(render(world_of(faces), ball, T, 16, False), ball, (64, 256))[0]
    difference = np.abs(direct.astype(float) - unwrapped)
    assert difference[away_from_edges(direct)].mean() <= 0.5
    assert difference.mean() <= 2.5
