"""Images against independent intersections, closed forms and symmetries."""

from __future__ import annotations

import cv2
import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from omnilab.api import PathPoses, RandomPoses
from omnilab.cameras import HyperbolicMirror
from omnilab.geometry import planar_poses
from omnilab.image import to_gray
from omnilab_mirror import Mirror
from omnilab_mirror.render.render import render
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.quads import Quad
from omnilab_mirror.scene.textures.canvas import Paint
from omnilab_mirror.scene.world import World


def painted(color) -> Paint:
    return Paint(lambda canvas: canvas.filled(color))


def world_of(faces) -> World:
    return World("test", (8, 6), faces, [], [], Illumination(1.0, []), 8, 0)


def pictures(sensor, T_world_camera):
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(PathPoses(T_world_camera)))])


def brute_force(faces, T, directions):
    """Index of the nearest face (..., ) along each direction (-1: none), and whether that is beyond doubt."""
    best = np.full(directions.shape[:-1], np.inf)
    index, sure = np.full(best.shape, -1), np.ones(best.shape, bool)
    world = directions @ T[:3, :3].T
    for i, face in enumerate(faces):
        # O + t d = corner + x u + y v
        A = np.stack([world, np.broadcast_to(-face.u, world.shape), np.broadcast_to(-face.v, world.shape)], -1)
        t, x, y = np.moveaxis(np.linalg.solve(A, (face.corner - T[:3, 3])[:, None])[..., 0], -1, 0)
        margin = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
        sure &= (np.abs(margin) > 1e-6) & ((np.abs(t - best) > 1e-6) | (t < 0))
        nearer = (t > 0) & (margin > 0) & (t < best)
        best, index = np.where(nearer, t, best), np.where(nearer, i, index)
    return index, sure


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), crop=st.sampled_from([0.5, 1.0]))
def test_hits_agree_with_brute_force(seed, count, crop):
    rng = np.random.default_rng(seed)
    # faces of all sizes, also far larger and smaller than a tile of pixels, some around the camera
    scale = 10 ** rng.uniform(-1.5, 1, (count, 1))
    corner, u, v = (
        rng.normal(size=(count, 3)) * 2,
        rng.normal(size=(count, 3)) * scale,
        rng.normal(size=(count, 3)) * scale,
    )
    faces = [Quad(corner[i], u[i], v[i], painted([i + 1, 0, 255 - i])) for i in range(count)]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    camera = HyperbolicMirror(size=50, crop=crop)
    image = render(world_of(faces), camera, T[None], samples=1, color=True)[0]
    v, u = np.mgrid[:50, :50]
    directions = camera.directions(np.stack([u, v], -1).astype(float))
    seen = np.isfinite(directions[..., 0])
    index, sure = brute_force(faces, T, np.nan_to_num(directions, nan=1.0))
    expected = np.where(seen, index, -1) + 1
    assert sure.mean() > 0.95
    assert np.array_equal(image[..., 0][sure], expected[sure])


def test_north_is_up_and_east_is_right():
    wall = [0, 0, 1.0]
    north = Quad(np.array([-0.5, 2, 0.5]), np.array([1.0, 0, 0]), np.array(wall), painted([255, 0, 0]))
    east = Quad(np.array([2, -0.5, 0.5]), np.array([0, 1.0, 0]), np.array(wall), painted([0, 0, 255]))
    image = render(world_of([north, east]), HyperbolicMirror(), planar_poses([0, 0, 1]), 1, color=True)[0]
    v, u = np.nonzero(image[..., 0])
    assert v.max() < 125
    assert u.mean() == pytest.approx(124.5, abs=0.5)
    v, u = np.nonzero(image[..., 2])
    assert u.min() > 124
    assert v.mean() == pytest.approx(124.5, abs=0.5)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.1])
def test_corners_of_a_chessboard_appear_where_the_camera_model_says(write, heading):
    board = "{kind: tiles, colors: [[255, 255, 255], [0, 0, 0]], side_m: 0.5, joint_m: 0, ordered: true}"
    world = write(
        f"map_m: [8, 6]\ntextures:\n  board: {board}\nobjects:\n  - {{kind: rug, at: [0, 0], size: [6, 6], texture: board}}\n"
    )
    T = planar_poses([0.13, -0.21, 1.0], heading)
    image = pictures(Mirror(world=world, size=500, samples=9), T)[0]
    corners = np.array([[x, y, 0.004] for x in (-1, -0.5, 0.5, 1.0) for y in (-1, 0, 0.5)])
    expected = HyperbolicMirror(size=500).pixels((corners - T[0, :3, 3]) @ T[0, :3, :3]).astype(np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 0.001)
    found = cv2.cornerSubPix(image, expected[:, None] + np.float32(0.8), (4, 4), (-1, -1), criteria)[:, 0]
    assert np.linalg.norm(found - expected, axis=1).max() < 0.15  # the finder takes the edges for straight


def test_a_quarter_turn_is_a_quarter_turn_of_the_image():
    at = [0.5, -1.0, 1.0]
    zero, quarter = pictures(Mirror(), planar_poses([at, at], [0, np.pi / 2]))
    # counter-clockwise turn of the camera: the image turns clockwise; rays on a face's edge may fall to either side
    difference = np.abs(np.rot90(zero, -1).astype(int) - quarter)
    assert (difference > 1).mean() < 1e-3


@pytest.mark.parametrize("turn", [0.3, -1.234])
def test_any_turn_is_a_turn_of_the_image(turn):
    at = [0.5, -1.0, 1.0]
    sensor = Mirror()
    zero, turned = pictures(sensor, planar_poses([at, at], [0, turn])).astype(np.float32)
    center = (sensor.camera.center, sensor.camera.center)
    rotation = cv2.getRotationMatrix2D(center, -np.rad2deg(turn), 1)  # clockwise, as OpenCV counts the other way
    expected = cv2.warpAffine(zero, rotation, zero.shape, flags=cv2.INTER_CUBIC)
    v, u = np.mgrid[:250, :250]
    inside = np.hypot(u - center[0], v - center[1]) < 122
    contrast = cv2.morphologyEx(turned, cv2.MORPH_GRADIENT, np.ones((5, 5)))
    difference = np.abs(expected - turned)
    assert difference[inside].mean() < 2.5
    assert difference[inside & (contrast < 20)].mean() < 0.5
    # and the other way round it is not
    wrong = cv2.warpAffine(zero, cv2.getRotationMatrix2D(center, np.rad2deg(turn), 1), zero.shape)
    assert np.abs(wrong - turned)[inside].mean() > 10


def test_tilted_and_turned_cameras_see_the_same_points():
    target = np.array([1.5, 0.7, 1.4])
    dot = Quad(target - [0, 0.02, 0.02], np.array([0, 0.04, 0]), np.array([0, 0, 0.04]), painted([255, 255, 255]))
    camera = HyperbolicMirror(size=500, crop=1.0)
    for angles in ([10, 0, 0], [0, -20, 5], [15, 15, 100]):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix(), [0, 0, 1]
        image = render(world_of([dot]), camera, T[None], 9, color=False)[0]
        v, u = np.nonzero(image > 100)
        assert np.allclose([u.mean(), v.mean()], camera.pixels(T[:3, :3].T @ (target - T[:3, 3])), atol=0.5)


def test_symmetrical_room_makes_symmetrical_images(write):
    room = "map_m: [4, 4]\nlight: {ambient: 0.3, lamps: [{at: [0, 0, 2.5]}]}\nobjects:\n"
    room += "  - {kind: room, size: [6, 5, 3], north: [90, 0, 0], south: [90, 0, 0], floor: [50, 90, 10]}\n"
    sensor = Mirror(world=write(room), size=120)
    here, opposite, reflected = pictures(sensor, planar_poses([[0.9, 0.3, 1], [-0.9, -0.3, 1], [-0.9, 0.3, 1]]))
    assert np.abs(here.astype(int) - opposite[::-1, ::-1]).max() <= 1
    assert np.abs(here.astype(int) - reflected[:, ::-1]).max() <= 1
    assert np.abs(here.astype(int) - reflected).max() > 20


def test_floor_below_the_camera_has_the_brightness_of_lambert_s_law(write):
    text = "map_m: [1, 1]\nlight: {ambient: 0.2, lamps: [{at: [1.5, 0, 2], power: 0.9, reach_m: 3}]}\nobjects:\n"
    image = pictures(Mirror(world=write(text + "  - {kind: room, size: [4, 4, 3], floor: [200, 200, 200]}\n"), size=101),
                     planar_poses([0, 0, 1]))[0]  # fmt: skip
    distance2 = 1.5**2 + 2**2
    expected = 200 * (0.2 + 0.9 * 2 / np.sqrt(distance2) / (1 + distance2 / 9))
    assert image[50, 50] == pytest.approx(expected, abs=1)


def test_a_fine_pattern_far_away_is_grey(write):
    board = "{kind: tiles, colors: [[250, 250, 250], [0, 0, 0]], side_m: 0.03, joint_m: 0, ordered: true}"
    world = write(
        f"map_m: [8, 6]\ntexels_per_m: 100\ntextures:\n  board: {board}\nobjects:\n"
        "  - {kind: rug, at: [0, 0], size: [16, 16], texture: board}\n"
    )
    image = pictures(Mirror(world=world), planar_poses([0, 0, 1]))[0].astype(float)
    v, u = np.mgrid[:250, :250]
    radius = np.hypot(u - 124.5, v - 124.5)
    far = image[(radius > 60) & (radius < 75)]
    assert far.mean() == pytest.approx(125, abs=4)
    assert far.std() < 8
    assert image[radius < 20].std() > 20


def test_grey_is_the_luma_of_colour():
    poses = planar_poses([[0.5, -1, 1], [-2, 1.5, 1]], [0.4, 2])
    grey, color = (pictures(Mirror(color=color, size=150), poses) for color in (False, True))
    assert np.abs(to_gray(color).astype(int) - grey).max() <= 1
    assert color.std(axis=-1).mean() > 5


def test_number_of_threads_changes_nothing():
    sensor = Mirror(size=100)
    plan = sensor.plan(RandomPoses(5, seed=2))
    images = {}
    threads = numba.get_num_threads()
    try:
        for count in {1, threads}:
            numba.set_num_threads(count)
            images[count] = next(sensor.frames(plan)).images
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(images[1], images[threads])


def test_batches_stream_and_change_nothing():
    plan = Mirror().plan(RandomPoses(7, seed=3))
    batches = list(Mirror(batch=3, size=64).frames(plan))
    whole = next(Mirror(batch=7, size=64).frames(plan))
    assert [len(frames) for frames in batches] == [3, 3, 1]
    assert np.array_equal(np.concatenate([frames.images for frames in batches]), whole.images)
    assert [k for frames in batches for k in frames.keys] == list(plan.keys)
    assert np.array_equal(np.concatenate([frames.plan_index for frames in batches]), np.arange(7))
    assert np.array_equal(np.concatenate([frames.stamps_ns for frames in batches]), np.arange(7) * 100_000_000)
    assert np.array_equal(np.concatenate([frames.T_world_camera for frames in batches]), plan.T_world_camera)


def test_more_samples_come_closer_to_many():
    pose = planar_poses([0.5, -1, 1])
    one, four, many = (pictures(Mirror(samples=n, size=120), pose)[0].astype(float) for n in (1, 4, 64))
    assert np.abs(four - many).mean() < 0.6 * np.abs(one - many).mean()


def test_the_room_has_no_holes():
    for frames in Mirror(size=200, samples=1).frames(Mirror().plan(RandomPoses(20, seed=5))):
        assert frames.images.min() > 0


def test_scene_lies_on_the_faces_and_is_open_above():
    mesh, world = Mirror().scene(), load_world("room")
    assert len(mesh.triangles) < 30_000
    assert mesh.triangles.max() == len(mesh.vertices_m) - 1 == len(mesh.colors) - 1
    corners = mesh.vertices_m[mesh.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    shown = [face for face in world.quads if not face.overhead]
    assert area == pytest.approx(sum(np.linalg.norm(np.cross(face.u, face.v)) for face in shown))
    centers = corners.mean(axis=1)
    assert not np.any((centers[:, 2] > 2.99) & (np.abs(centers[:, :2]).max(axis=1) < 3.9))
    floor = mesh.colors[np.abs(mesh.vertices_m[:, 2]) < 1e-9].mean(axis=0)
    assert floor[0] > floor[1] > floor[2] > 20  # wood

    # outer walls and floor face into the room: a viewer that draws one side alone shows it from outside, too
    assert mesh.one_sided
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # twice as long as the area
    low, high = mesh.vertices_m.min(0), mesh.vertices_m.max(0)
    planes = [(axis, low[axis], 1) for axis in range(3)] + [(axis, high[axis], -1) for axis in range(2)]
    for axis, at, inward in planes:
        there = (np.abs(corners[:, :, axis] - at) < 1e-9).all(axis=1)
        size = np.prod(np.delete(high - low, axis))
        assert (inward * normals[there, axis]).clip(min=0).sum() / 2 > 0.6 * size, "all but windows and doors"
