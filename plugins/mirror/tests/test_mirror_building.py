"""Walls, doors, cylinders, trees, areas, pictures and the sky, against geometry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.errors import DataError
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.model import Model
from omnilab_mirror.scene.quads import Place
from omnilab_mirror.scene.world import World

TOP = "map_m: [1, 1]\ntexels_per_m: 32\n"


@pytest.fixture
def built(write):
    """Builds the world of some lines below `objects`."""

    def built(*objects: str, top: str = "") -> World:
        return load_world(write(TOP + top + "objects:\n" + "".join(f"  - {{{line}}}\n" for line in objects)))

    return built


def normals(world):
    return np.array([np.cross(face.u, face.v) for face in world.quads])


def volume(faces) -> float:
    """Gauss: outward normals give the volume."""
    return sum((face.corner + (face.u + face.v) / 2) @ np.cross(face.u, face.v) for face in faces) / 3


@pytest.mark.parametrize("sides", [4, 6, 10, 16])
def test_a_cylinder_is_a_closed_prism_on_a_regular_polygon(built, sides):
    world = built(f"kind: cylinder, at: [1, 2], z: 0.5, size: [2, 3], sides: {sides}, turn_deg: 20")
    polygon = sides / 2 * np.sin(2 * np.pi / sides)
    assert len(world.quads) == sides + sides // 2 * (sides // 2 - 1)
    assert np.allclose(normals(world).sum(axis=0), 0)
    assert volume(world.quads) == pytest.approx(3 * polygon)
    top = [face for face in world.quads if np.cross(face.u, face.v)[2] > 1e-9]
    assert sum(np.cross(face.u, face.v)[2] for face in top) == pytest.approx(polygon)
    # no two rhombi of the top overlap: each random point of the polygon is in one
    points = np.random.default_rng(0).uniform((0, 1), (2, 3), (500, 2))
    inside = np.zeros(500, int)
    for face in top:
        share = np.linalg.solve(np.stack([face.u[:2], face.v[:2]], 1), (points - face.corner[:2]).T)
        inside += np.all((share > 0) & (share < 1), axis=0)
    radius = np.linalg.norm(points - [1, 2], axis=1)
    assert np.all(inside[radius < np.cos(np.pi / sides)] == 1)
    assert np.all(inside[radius > 1] == 0)


def test_a_cylinder_on_the_floor_lacks_its_lower_end(built):
    world = built("kind: cylinder, at: [0, 0], size: [1, 2], sides: 8")
    assert len(world.quads) == 8 + 6
    assert min(normals(world)[:, 2]) > -1e-9


@given(seed=st.integers(0, 10**6), count=st.integers(3, 7))
def test_zonohedra_are_closed_and_have_the_volume_of_their_generators(seed, count):
    g = np.random.default_rng(seed).normal(size=(count, 3))
    model = Model({})
    model.zonohedron(Place(np.array([3.0, 1, 2]), 0.7), g, None)
    triple = sum(
        abs(np.linalg.det(g[[i, j, k]])) for i in range(count) for j in range(i) for k in range(j)
    )  # Shephard, 1974
    assert volume(model.quads) == pytest.approx(triple)
    assert np.allclose(sum(np.cross(face.u, face.v) for face in model.quads), 0)


def test_trees_stand_and_their_crowns_are_as_wide_and_high_as_they_say(built):
    world = built("kind: tree, at: [2, 1], size: [3, 5], trunk_m: 2")
    corners = np.array([face.corner + a * face.u + b * face.v for face in world.quads for a in (0, 1) for b in (0, 1)])
    assert corners[:, 2].min() == pytest.approx(0)
    assert corners[:, 2].max() == pytest.approx(5)
    assert np.ptp(corners[:, 0]) == pytest.approx(3, abs=0.01)
    assert obstacles(world, np.array([[2, 1, 1.0], [2.8, 1, 1], [2.8, 1, 3]])) == [
        "inside 'trunk of tree'",
        "",
        "inside 'tree'",
    ]


WALL = "kind: wall, from: [0, 0], to: [0, 4], height: 3, thickness: 0.2"


def test_walls_are_solid_but_for_their_openings(built):
    world = built(WALL + ", openings: [{at: 1, width: 1, height: 2}, {at: 3, width: 0.8, height: 1, bottom: 1}]")
    points = np.array(
        [[0, y, z] for y, z in [(0.2, 1), (1, 1), (1, 2.5), (2, 1), (3, 0.5), (3, 1.5), (3, 2.5), (4.2, 1)]]
    )
    assert [bool(why) for why in obstacles(world, points)] == [True, False, True, True, True, False, True, False]
    areas = np.abs(normals(world))
    both_sides = 2 * (4 * 3 - 1 * 2 - 0.8 * 1)
    reveals = 0.2 * (1 + 2 * 2) + 0.2 * (2 * 0.8 + 2 * 1)
    assert areas[:, 0].sum() == pytest.approx(both_sides)
    assert areas.sum() == pytest.approx(both_sides + reveals)


def test_a_wall_s_texture_is_on_the_right_and_its_back_on_the_left(built):
    world = built(WALL + ", texture: [1, 2, 3], back: [4, 5, 6]")
    for face, picture in zip(world.quads, baked_pictures(world), strict=True):
        middle = face.corner + (face.u + face.v) / 2
        assert middle[0] == pytest.approx(0.1 if picture[0, 0, 0] == 1 else -0.1)  # one walks north
        assert np.sign(np.cross(face.u, face.v)[0]) == np.sign(middle[0])


def test_a_pattern_runs_through_behind_the_openings(built):
    tiles = "textures:\n  it: {kind: bricks, color: [200, 60, 50]}\n"
    whole = baked_pictures(built("kind: wall, from: [0, 0], to: [4, 0], height: 2, texture: it", top=tiles))[0]
    world = built(
        "kind: wall, from: [0, 0], to: [4, 0], height: 2, texture: it, openings: [{at: 1.5, width: 1, height: 1.5}]",
        top=tiles,
    )
    shown = [
        (face, picture)
        for face, picture in zip(world.quads, baked_pictures(world), strict=True)
        if face.corner[1] < 0 and face.u[0] > 0.5
    ]
    assert len(shown) == 3
    for face, picture in shown:
        x, y = round(face.corner[0] * 32), round(face.corner[2] * 32)
        assert np.array_equal(picture, whole[y : y + len(picture), x : x + picture.shape[1]])


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        (WALL + ", openings: [{at: 0.2}]", "opening 1 reaches beyond its wall of 4.00 x 3 m"),
        (WALL + ", openings: [{at: 1, height: 3.5}]", "reaches beyond"),
        (WALL + ", openings: [{at: 1}, {at: 1.5}]", "openings that overlap"),
        (WALL.replace("[0, 4]", "[0, 0]"), "at least a centimetre from the other end"),
        ("kind: cylinder, at: [0, 0], size: [1, 1], sides: 7", "sides=7; expected an even number"),
        ("kind: tree, at: [0, 0], size: [1, 3], trunk_m: 4", "trunk_m=4; expected a finite number from 0.01 to 3"),
    ],
)
def test_what_cannot_be_built_is_reported(built, objects, message):
    with pytest.raises(DataError, match=message):
        built(objects)


def test_doors_turn_on_their_hinge(built):
    world = built(
        "kind: door, at: [1, 0], size: [0.8, 2], turn_deg: 90, open_deg: 90"
    )  # closed to the north, open to the west
    points = np.array([[0.6, 0, 1], [1.4, 0, 1], [1, 0.4, 1]])
    assert obstacles(world, points) == ["inside 'door'", "", ""]


def test_viewpoints_are_in_one_of_the_areas(built):
    world = built(
        "kind: area, name: yard, at: [5, 0], size: [4, 2]",
        "kind: area, name: shed, at: [0, 0], size: [2, 2], height: 2.5",
    )
    points = np.array([[0, 0, 1], [0, 0, 2.48], [5, 0.99, 1], [5, 0, 20], [2, 0, 1]])
    assert obstacles(world, points) == ["", "outside the shed and the yard", "", "", "outside the shed and the yard"]


# ---------------------------------------------------------------------------------------------------- pictures, the sky
@pytest.fixture
def picture(tmp_path):
    """A picture file: red above green left, blue right."""
    pixels = np.zeros((20, 40, 3), np.uint8)
    pixels[:10, :, 0], pixels[10:, :20, 1], pixels[10:, 20:, 2] = 250, 250, 250
    cv2.imwrite(str(tmp_path / "picture.png"), pixels[..., ::-1])
    return pixels


def test_images_hang_upright_and_tiles_repeat(built, picture):
    panel = "kind: face, corners: [[0, 2, 0], [2, 2, 0], [2, 2, 1], [0, 2, 1]], texture: it"
    image = baked_pictures(built(panel, top="textures:\n  it: {kind: image, file: picture.png}\n"))[0]
    assert [image[y, x].argmax() for y, x in [(-3, 5), (-3, -5), (3, 5), (3, -5)]] == [0, 0, 1, 2]
    tiled = baked_pictures(built(panel, top="textures:\n  it: {kind: image, file: picture.png, tile_m: [1, 0.5]}\n"))[0]
    assert np.array_equal(tiled[:16], tiled[16:])
    assert np.array_equal(tiled[:, :32], tiled[:, 32:])
    assert np.array_equal(tiled[3, [5, 27]].argmax(axis=1), [1, 2])


def test_a_changed_picture_is_another_world(built, picture, tmp_path):
    rug, top = "kind: rug, at: [0, 0], size: [1, 1], texture: it", "textures:\n  it: {kind: image, file: picture.png}\n"
    before = built(rug, top=top)
    assert built(rug, top=top) is before
    cv2.imwrite(str(tmp_path / "picture.png"), 255 - picture)
    after = built(rug, top=top)
    assert after.digest != before.digest
    assert np.abs(baked_pictures(after)[0].astype(int) - baked_pictures(before)[0]).max() > 100


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("missing.png", "No such file"),
        ("../picture.png", "below the world's folder"),
        ("/etc/passwd", "below the world's folder"),
        ("world.yaml", "such as PNG or JPEG"),
        ("empty.png", "1 to 20000000 bytes, not 0"),
    ],
)
def test_pictures_that_cannot_be_used(built, picture, tmp_path, file, message):
    (tmp_path / "empty.png").touch()
    with pytest.raises(DataError, match=rf"line 4: 'it' has file='{file}'; .*{message}"):
        built(
            "kind: rug, at: [0, 0], size: [1, 1], texture: it", top=f"textures:\n  it: {{kind: image, file: {file}}}\n"
        )


def sky(built, texture) -> np.ndarray:
    return built("kind: area, size: [4, 4]", top=f"sky: it\ntextures:\n  it: {{{texture}}}\n").sky.astype(int)


def test_the_sun_stands_where_it_says_and_the_sky_closes_around(built):
    pixels = sky(built, "kind: sky, clouds: 0, sun_deg: [120, 35], zenith: [20, 40, 90], horizon: [60, 80, 120]")
    h, w, _ = pixels.shape
    row, column = np.nonzero(pixels.sum(axis=2) > 715)
    assert 360 * (column.mean() + 0.5) / w == pytest.approx(120, abs=0.5)
    assert 90 - 180 * (row.mean() + 0.5) / h == pytest.approx(35, abs=0.5)
    clouds = sky(built, "kind: sky, clouds: 0.6")
    step = np.abs(np.diff(clouds, axis=1, append=clouds[:, :1])).max(axis=2)
    assert step[:, -1].mean() < 1.5 * step.mean() + 0.1
    assert step.mean() > 0.1
    assert np.all(clouds[h // 2 + 20 :] == [150, 150, 140])


def test_photographs_of_the_sky_are_laid_around_without_a_mirror(built, picture):
    pixels = sky(built, "kind: image, file: picture.png")
    h, w, _ = pixels.shape
    # looking along -x at the middle of the photograph, green is to the left, towards -y
    colors = [pixels[row, column].argmax() for row, column in [(9, 9), (h - 9, w // 2 + 99), (h - 9, w // 2 - 99)]]
    assert colors == [0, 1, 2]


def test_what_does_not_close_around_the_sphere_is_no_sky(built):
    with pytest.raises(DataError, match=r"line 3: the world has sky='it'; .* closes around the sphere"):
        sky(built, "kind: noise, color: [1, 2, 3]")
    with pytest.raises(DataError, match="unknown sky 'it'; did you mean 'its'"):
        built("kind: area, size: [4, 4]", top="sky: it\ntextures:\n  its: {kind: sky}\n")
    assert np.all(sky(built, "kind: plain, color: [9, 8, 7]") == [9, 8, 7])
