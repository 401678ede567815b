"""Meshes as worlds against closed forms and against the same room of faces, and where in them a camera may be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

import omnilab_mirror
from omnilab.api import GridPoses, PathPoses, RandomPoses
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror, StereoCamera
from omnilab.geometry import planar_poses
from omnilab_mirror import Mirror
from omnilab_mirror.render.embree import Embree, bundle_of
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.render.render import render
from omnilab_mirror.scene.light import Illumination, Lamp
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.meshes.mesh_world import floor_height
from omnilab_mirror.scene.meshes.triangles import Triangles, halves

BOOKSTORE = Path(__file__).parents[4] / "shared/data/aws_bookstore/bookstore.obj"
PLAIN = Illumination(1.0, [])
SPHERE = EquirectangularCamera(64, 32)


def soup(corners, colors=255, picture=None, uv=None) -> Triangles:
    """Triangles (T, 3, 3) with colours (broadcast to (T, 3, 3)) and one picture."""
    corners = np.asarray(corners, np.float32)
    none = np.zeros(len(corners), np.int32)
    uv = np.zeros((*corners.shape[:2], 2)) if uv is None else uv
    tint = np.broadcast_to(np.asarray(colors, np.uint8), corners.shape)
    picture = np.full((1, 1, 3), 255, np.uint8) if picture is None else picture
    return Triangles(corners, np.asarray(uv, np.float32), none, tint, none, none.astype(bool), [picture], ["it"])


def square(z: float, half: float = 50.0):
    """Two triangles of a level square."""
    a, b, c, d = ([x, y, z] for x, y in ((-half, -half), (half, -half), (half, half), (-half, half)))
    return [[a, b, c], [a, c, d]]


def directions(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    return camera.directions(np.stack([u, v], -1).astype(float))


# ------------------------------------------------------------------------------------------------ rays and shading
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
def test_rays_meet_the_nearest_triangle(seed, count):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) * 3 + rng.normal(size=(count, 3, 3)) * 10 ** rng.uniform(-1, 1)
    corners = corners.astype(np.float32).astype(float)
    colors = np.repeat(np.column_stack([np.arange(count) + 1, np.zeros(count), np.zeros(count)])[:, None], 3, axis=1)
    T = planar_poses(rng.normal(size=3), rng.uniform(0, 6))
    embree = Embree(soup(corners, colors), PLAIN, None)
    image, depth = embree.images(SPHERE, T, 1, True)[0, ..., 0], embree.depths(SPHERE, T)[0]
    d = directions(SPHERE) @ T[0, :3, :3].T
    best, index, sure = np.full(d.shape[:2], np.inf), np.zeros(d.shape[:2], int), np.ones(d.shape[:2], bool)
    for i, (a, b, c) in enumerate(corners):
        M = np.stack([-d, np.broadcast_to(b - a, d.shape), np.broadcast_to(c - a, d.shape)], -1)
        t, u, v = np.moveaxis(np.linalg.solve(M, (T[0, :3, 3] - a)[:, None])[..., 0], -1, 0)
        margin = np.minimum(np.minimum(u, v), 1 - u - v)
        sure &= (np.abs(margin) > 1e-3) & ((np.abs(t - best) > 1e-3 * np.abs(t)) | (t < 0))
        hit = (t > 0) & (margin > 0) & (t < best)
        best, index = np.where(hit, t, best), np.where(hit, i + 1, index)
    assert sure.mean() > 0.8
    assert np.array_equal(image[sure], index[sure])
    assert np.array_equal(np.isinf(depth[sure]), np.isinf(best[sure]))
    seen = sure & np.isfinite(best)
    assert np.allclose(depth[seen], best[seen], rtol=1e-3)


def test_rays_of_a_camera_go_exactly_as_far_as_single_rays():
    rng, camera = np.random.default_rng(5), HyperbolicMirror()
    embree = Embree(soup(rng.normal(size=(3000, 1, 3)) * 3 + rng.normal(size=(3000, 3, 3)) / 4), PLAIN, None)
    T = planar_poses([0.2, -0.1, 0.3], 0.4)
    (R, at), bundle = (T[0, :3, :3].astype(np.float32), T[0, :3, 3].astype(np.float32)), bundle_of(camera, 1)
    turned = (R[:, :1] * bundle.direction[0] + R[:, 1:2] * bundle.direction[1]) + R[:, 2:] * bundle.direction[2]
    triangle, distance = embree.tree.meet(np.tile(at, (len(bundle.pixel), 1)), turned.T)
    expected = np.full(camera.height * camera.width, np.inf, np.float32)
    expected[bundle.pixel[triangle >= 0]] = distance[triangle >= 0]
    assert np.array_equal(embree.depths(camera, T).ravel(), expected)
    assert 0.2 < np.mean(triangle >= 0) < 1


def test_colours_of_the_corners_blend_linearly():
    corners = [[[-50, -50, 0], [50, -50, 0], [-50, 50, 0]], [[50, 50, 0], [50, -50, 0], [-50, 50, 0]]]
    # red = 100 + 2 x and blue = 100 - y, both flat over the square
    colors = [[[100 + 2 * x, 0, 100 - y] for x, y, _ in triangle] for triangle in corners]
    T = planar_poses([3.0, 4.0, 2.0])
    image = Embree(soup(corners, colors), PLAIN, None).images(SPHERE, T, 1, True)[0].astype(float)
    d = directions(SPHERE)
    down = d[..., 2] < -0.1
    x, y = (T[0, i, 3] - 2.0 * d[down][:, i] / d[down][:, 2] for i in (0, 1))
    assert np.abs(image[down][:, 0] - (100 + 2 * x)).max() <= 0.51
    assert np.abs(image[down][:, 2] - (100 - y)).max() <= 0.51
    assert np.all(image[down][:, 1] == 0)


@pytest.mark.parametrize("side", [1, -1])
def test_lamps_light_the_side_that_is_seen_by_lambert_s_law(side):
    lamp, at = Lamp(np.array([1.5, 0, 2.0 * side]), 0.9, 3.0), np.array([0.4, -0.3, 1.0 * side])
    T = planar_poses(at)
    image = Embree(soup(square(0.0), 200), Illumination(0.2, [lamp]), None).images(SPHERE, T, 1, False)[0]
    d = directions(SPHERE)
    met = d[..., 2] * side < -0.1
    points = at - d[met] * (at[2] / d[met][:, 2])[:, None]
    distance = np.linalg.norm(lamp.at - points, axis=1)
    expected = 200 * (0.2 + 0.9 * 2.0 / distance / (1 + (distance / 3) ** 2))
    assert np.abs(image[met] - expected).max() <= 0.51


def test_skylight_is_brightest_on_what_faces_the_sky():
    up, down = (
        Embree(soup(square(z), 200), Illumination(0.85, [], skylight=0.15), None).images(SPHERE, planar_poses([0, 0, 1.0]), 1, False)[0, row, 0]
        for z, row in ((0.0, -1), (2.0, 0))
    )  # fmt: skip
    assert [up, down] == [round(200 * (0.85 + s * 0.15 * 4 / np.sqrt(21))) for s in (1, -1)]


def test_textures_wrap_and_are_read_right_and_down():
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :, 0], picture[:, 32:, 2] = 200, 200  # upper half red, right half blue
    corners = square(0.0, 4.0)
    uv = np.array(corners)[..., :2] * [1, -1] / 2.0  # one picture every 2 m, its upper edge to the north
    image = Embree(soup(corners, 255, picture, uv), PLAIN, None).images(SPHERE, planar_poses([0, 0, 1.0]), 1, True)[0]
    d = directions(SPHERE)
    met = d[..., 2] < -0.4
    x, y = (-d[met][:, i] / d[met][:, 2] for i in (0, 1))
    right, down = x / 2 % 1, -y / 2 % 1
    sure = np.all(np.abs(np.stack([right, down])[..., None] - [0, 0.5, 1]).min(axis=2) > 0.05, axis=0)
    assert sure.mean() > 0.4
    assert np.array_equal(image[met][sure][:, 0] > 100, down[sure] < 0.5)
    assert np.array_equal(image[met][sure][:, 2] > 100, right[sure] > 0.5)


def test_a_fine_texture_far_away_is_grey():
    picture = np.kron((np.indices((32, 32)).sum(axis=0) % 2)[..., None], np.full((1, 1, 3), 250)).astype(np.uint8)
    corners = square(0.0, 64.0)
    triangles = soup(corners, 255, picture, np.array(corners)[..., :2])  # squares of 3 cm
    image = Embree(triangles, PLAIN, None).images(HyperbolicMirror(), planar_poses([0, 0, 1.5]), 1, False)[0]
    v, u = np.mgrid[:250, :250]
    ring = (np.hypot(u - 124.5, v - 124.5) > 60) & (np.hypot(u - 124.5, v - 124.5) < 80)
    assert np.abs(image[ring].astype(float) - 125).mean() < 4


def test_the_sky_is_seen_past_everything_and_turns_with_the_camera():
    sky = np.zeros((90, 180, 3), np.uint8)
    sky[:45, :45] = 200  # the upper quarter from +x to +y
    image = Embree(soup(square(-900.0, 1.0)), PLAIN, sky).images(SPHERE, planar_poses([0, 0, 0], 0.3), 1, False)[0]
    d = directions(SPHERE) @ planar_poses([0, 0, 0], 0.3)[0, :3, :3].T
    azimuth, elevation = np.degrees(np.arctan2(d[..., 1], d[..., 0])) % 360, np.degrees(np.arcsin(d[..., 2]))
    sure = np.minimum(np.minimum(azimuth, np.abs(azimuth - 90)), np.minimum(360 - azimuth, np.abs(elevation))) > 8
    assert np.array_equal(image[sure] > 100, (azimuth[sure] < 90) & (elevation[sure] > 0))


def test_rays_start_where_a_camera_without_viewpoint_says():
    pair = StereoCamera(width=64, height=48, focal_px=40.0, baseline_m=0.5)
    world = Embree(soup(square(0.0)), PLAIN, None)
    T = planar_poses([1.0, 2.0, 1.0], 0.7)
    depth = world.depths(pair, T)
    for half, eye, side in (
        (depth[..., : pair.width // 2], pair.left, 0.25),
        (depth[..., pair.width // 2 :], pair.right, -0.25),
    ):
        moved = T.copy()
        moved[:, :3, 3] += T[0, :3, :3] @ [0, side, 0]
        assert np.isfinite(half).any()
        assert np.allclose(half, world.depths(eye, moved), rtol=1e-5)


# ------------------------------------------------------------------------------------------------ the room, twice
@pytest.fixture(scope="module")
def room_files(tmp_path_factory):
    """The shipped room, coarser, and its faces exported by trimesh as OBJ and GLB, in folders of their own."""
    text = (Path(omnilab_mirror.__file__).parent / "worlds/room.yaml").read_text()
    coarse = tmp_path_factory.mktemp("faces") / "room.yaml"
    coarse.write_text(re.sub(r"texels_per_m: \d+", "texels_per_m: 64", text))
    world, out = load_world(str(coarse)), {"faces": str(coarse)}
    parts = halves(world.quads, baked_pictures(world))
    for kind in ("obj", "glb"):
        folder, scene = tmp_path_factory.mktemp(kind), trimesh.Scene()
        for i, picture in enumerate(parts.pictures):
            corners, uv = parts.corners[2 * i : 2 * i + 2].reshape(-1, 3), parts.uv[2 * i : 2 * i + 2].reshape(-1, 2)
            image = Image.fromarray(picture)
            image.format = "PNG"
            material = (
                SimpleMaterial(image=image, name=f"m{i}") if kind == "obj" else PBRMaterial(baseColorTexture=image)
            )
            mesh = trimesh.Trimesh(
                corners if kind == "obj" else corners[:, [0, 2, 1]] * [1, 1, -1],  # GLB is y up
                np.arange(6).reshape(2, 3),
                visual=TextureVisuals(uv * [1, -1] + [0, 1], material=material),
                process=False,
            )
            scene.add_geometry(mesh, geom_name=f"face{i}")
        scene.export(folder / f"room.{kind}")
        world_file = folder / "world.yaml"
        world_file.write_text(f"map_m: [8, 6]\nobjects:\n  - {{kind: mesh, file: room.{kind}, at: [0, 0]}}\n")
        out[kind] = str(world_file)
    return out


@pytest.mark.parametrize("kind", ["obj", "glb"])
@pytest.mark.parametrize("color", [False, True], ids=["grey", "colour"])
def test_the_room_as_faces_and_as_a_mesh_is_the_same_room(room_files, kind, color):
    faces, mesh = load_world(room_files["faces"]), load_world(room_files[kind])
    T = Mirror().plan(RandomPoses(4, seed=3)).T_world_camera
    one, other = (render(world, HyperbolicMirror(), T, 4, color).astype(int) for world in (faces, mesh))
    difference = np.abs(one - other)
    # textures of a mesh repeat, so half a texel at the border of each face is blended with the opposite border
    assert difference.mean() < 0.25
    assert (difference > 8).mean() < 0.005
    assert one.std() > 30


def test_faces_beside_a_mesh_are_traced_as_faces_alone(write, small, tmp_path):
    trimesh.Trimesh([[0, 0, -9], [1, 0, -9], [0, 1, -9]], [[0, 1, 2]]).export(tmp_path / "far.ply")
    both = load_world(write(small + "  - {kind: mesh, file: far.ply, at: [0, 0]}\n", "both.yaml"))
    T = planar_poses([[0.2, -0.4, 1.2], [-0.5, 0.3, 0.9]], [0.0, 1.0])
    one, other = (render(world, HyperbolicMirror(), T, 4, True) for world in (load_world(write(small)), both))
    difference = np.abs(one.astype(int) - other)
    # only rays that meet an edge may fall to either side
    assert difference.mean() < 0.01
    assert (difference > 1).mean() < 1e-3


def test_any_batch_gives_the_same_images(room_files):
    poses = RandomPoses(5, seed=1)
    one, other = (Mirror(world=room_files["obj"], size=60, batch=batch) for batch in (1, 5))
    images = [np.concatenate([f.images for f in s.frames(s.plan(poses))]) for s in (one, other)]
    assert np.array_equal(*images)


# ------------------------------------------------------------------------------------------------- floors and obstacles
def test_a_mesh_world_has_its_floor_at_0_and_its_middle_above_the_origin(save):
    room = trimesh.creation.box(extents=[6, 4, 3])
    room.invert()
    room.apply_translation([100, 50, -7])
    world = load_world(save("room.ply", vertices=room.vertices, faces=room.faces))
    assert world.map_m == pytest.approx((6, 4))
    assert np.allclose(world.meshes[0].bounds, [[-3, -2, 0], [3, 2, 3]], atol=1e-5)


def test_the_floor_is_the_lower_level_with_most_area():
    floor, cellar, ceiling = soup(square(0.2)), soup(square(-0.3, 10)), soup(square(3.0, 60))
    both = np.concatenate([floor.corners, cellar.corners, ceiling.corners])
    assert floor_height(soup(both)) == pytest.approx(0.2, abs=1e-6)


FURNISHED = """\
map_m: [4, 4]
objects:
  - {kind: room, size: [6, 6, 3]}
  - {kind: mesh, name: the crate, file: crate.obj, at: [1, 0], turn_deg: 30, scale: 0.5}
  - {kind: mesh, file: board.ply, at: [-1, 0], z: 0.8}
"""


@pytest.fixture
def furnished(write, tmp_path):
    """A room with a crate that has no bottom, and a board at 0.8 m."""
    crate = trimesh.creation.box(extents=[1, 1, 3])
    crate.apply_translation([0, 0, 1.5])
    keep = crate.face_normals[:, 2] > -0.5
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in crate.vertices)
    faces = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in crate.faces[keep])
    (tmp_path / "crate.obj").write_text(f"{vertices}o crate\n{faces}")
    trimesh.Trimesh([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]], [[0, 1, 2], [0, 2, 3]]).export(
        tmp_path / "board.ply"
    )
    return load_world(write(FURNISHED))


def test_meshes_are_in_the_way(furnished):
    points = np.array([[0, 0, 1.0], [1, 0, 1.0], [1.2, 0, 0.9], [-1, 0, 1.0], [-1, 0, 0.5], [-1, 0, 0.82], [5, 0, 1.0]])
    assert obstacles(furnished, points, on_floor=True) == [
        "",
        "inside 'the crate'",
        "inside 'the crate'",
        "above 'board.ply'",
        "",
        "too near to 'board.ply'",
        "outside the room",
    ]
    assert obstacles(furnished, points, on_floor=False)[3] == ""


def test_objects_of_kind_mesh_stand_where_the_file_says(furnished):
    crate = furnished.meshes[0].corners.reshape(-1, 3)
    assert np.allclose([crate[:, 2].min(), crate[:, 2].max()], [0, 1.5])
    assert np.allclose(np.ptp(crate[:, 0]), 0.5 * (np.cos(np.pi / 6) + np.sin(np.pi / 6)))
    assert np.allclose(crate[:, :2].mean(axis=0), [1, 0], atol=0.2)


def test_outside_a_mesh_there_is_no_pose(save):
    world = load_world(
        save("floor.ply", vertices=np.array(square(0.0, 2.0)).reshape(-1, 3), faces=[[0, 1, 2], [3, 4, 5]])
    )
    assert obstacles(world, np.array([[0, 0, 1.0], [2.5, 0, 1.0]])) == ["", "outside: nothing is below it"]


def test_the_scene_is_small_and_open_from_above(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=7, radius=0.6)
    room = trimesh.creation.box(extents=[6, 4, 3])
    trimesh.util.concatenate([ball, room]).export(tmp_path / "room.ply")
    mesh = Mirror(world=str(tmp_path / "room.ply")).scene()
    assert not mesh.one_sided
    assert len(ball.faces) > 60_000 >= len(mesh.triangles) > 1000
    heights = mesh.vertices_m[mesh.triangles][..., 2]
    assert not np.any(heights.min(axis=1) > 2.9)  # no ceiling
    assert np.any(heights.max(axis=1) > 2.9)  # but walls
    assert mesh.triangles.max() < len(mesh.vertices_m) == len(mesh.colors)


# ------------------------------------------------------------------------------------------------ a scanned shop
@pytest.mark.skipif(not BOOKSTORE.is_file(), reason="the bookstore is not in ../shared/data")
def test_the_bookstore_is_a_world():
    sensor = Mirror(world=str(BOOKSTORE), size=125)
    plan = sensor.plan(GridPoses(step_m=0.5))
    assert 300 < len(plan) < 700
    sentences = " ".join(plan.omitted)
    for name in ("DeskB", "BookshelfA", "RetailShopWall"):
        assert name in sentences
    world = load_world(str(BOOKSTORE))
    assert len(world.meshes[0]) == 118_189
    assert world.notes == []
    images = next(sensor.frames(plan.at(range(0, len(plan), 40)))).images
    assert images.mean() == pytest.approx(150, abs=50)
    assert np.all(images.std(axis=(1, 2)) > 20)
    path = sensor.plan(PathPoses(plan.T_world_camera[:1]))
    assert np.array_equal(next(sensor.frames(path)).images[0], images[0])
