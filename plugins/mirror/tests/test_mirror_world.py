"""World files, good and bad."""

from __future__ import annotations

import contextlib

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnilab.errors import ConfigError, DataError, OmnilabError
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.objects import OBJECTS
from omnilab_mirror.scene.shipped import shipped
from omnilab_mirror.scene.textures.procedural import TEXTURES

SQUARE = "[[-1, 1, 0], [1, 1, 0], [1, 1, 1], [-1, 1, 1]]"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (SQUARE, "[[-1, 1, 0], [1, 1, 0], [1, 1, 1]]", "line 13: object 3 has corners=.*4 corners, not 3"),
        (SQUARE, "[[-1, 1, 0], [1, 1, 0], [2, 1, 0], [1, 1, 1], [-1, 1, 1]]", "4 corners, not 5"),
        (SQUARE, "[[-1, 1, 0], [1, 1, 0], [1, 1.1, 1], [-1, 1, 1]]", "line 13.*4 corners in one plane"),
        (SQUARE, "[[-1, 1, 0], [1, 1, 0], [3, 1, 0], [1, 1, 0]]", "with an area"),
        (SQUARE, "[[-1, 1, 0], [1, 1, 0], [2, 1, 2], [-1, 1, 1]]", "parallelogram"),
        (SQUARE, "[[-1, 1, 0], [1, 1, .nan], [1, 1, 1], [-1, 1, 1]]", "points .*finite"),
        (SQUARE, "[[-1, 1], [1, 1], [1, 1], [-1, 1]]", "list of points"),
        (SQUARE, "wall", "corners='wall'; expected a list of points"),
        ("kind: box", "kind: bax", "line 11: object 2 has an unknown kind 'bax'; did you mean 'box'"),
        ("floor: boards", "floor: board", "line 10.*unknown floor 'board'; did you mean 'boards'"),
        ("kind: wood", "kind: woods", "line 8: 'boards' has an unknown kind 'woods'; did you mean 'wood'"),
        ("name: crate", "nome: crate", "unknown key 'nome'; did you mean 'name'"),
        ("size: [0.4, 0.4, 1.5]", "size: [0.4, 0.4]", "line 11.*size=.*list of 3 finite numbers"),
        ("size: [0.4, 0.4, 1.5]", "size: [0.4, 0, 1.5]", "at least 0.001"),
        ("size: [0.4, 0.4, 1.5]", "size: big", "size='big'"),
        ("size: [0.4, 0.4, 1.5], ", "", "lacks the key 'size'"),
        ("at: [0.8, 0.8]", "at: [0.8, .inf]", "finite"),
        ("at: [0.8, 0.8]", "at: [0.8, true]", "finite"),
        ("[200, 40, 40]", "[200, 40, 400]", r"texture=\[200, 40, 400\]"),
        ("reach_m: 2", "reach_m: .nan", "line 6: lamp 1 has reach_m=nan; expected a finite number from 0.01"),
        ("reach_m: 2", "reach_m: far", "reach_m='far'"),
        ("ambient: 0.5", "ambient: -1", "from 0 to 10"),
        ("map_m: [2, 2]\n", "", "lacks the key 'map_m'"),
        ("map_m: [2, 2]", "map_m: [2, 2]\nmap_m: [2, 2]", "'map_m' twice"),
        ("texels_per_m: 32", "texels_per_m: 9000", "up to 40000000 texels"),
        ("texels_per_m: 32", "textels_per_m: 32", "unknown key 'textels_per_m'; did you mean 'texels_per_m'"),
        ("texels_per_m: 32", "? [a]\n: 32", "a key that is not a name"),
        ("objects:", "objects: 3\nother:", "objects=3; expected a list"),
        ("texels_per_m: 32", "texels_per_m: &n 32\nseed: *n", "line 3: .* is an alias"),
        ("texels_per_m: 32", "texels_per_m: " + 20 * "[" + 20 * "]", "nested deeper"),
        ("texels_per_m: 32", "texels_per_m: [", "line "),
        ("texels_per_m: 32", "texels_per_m: !!python/name:os.system", "texels_per_m"),
        ("texels_per_m: 32", "seed: " + 5000 * "1", "seed"),
    ],
)
def test_a_mistake_is_reported_with_line_and_key(write, small, old, new, message):
    assert small.count(old) == 1
    file = write(small.replace(old, new))
    with pytest.raises(DataError, match=message) as error:
        load_world(file)
    assert file in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("", "is empty"),
        ("- a", "mapping"),
        (b"\xff\xfe\xfa", "YAML text"),
        (b"\x00\x01", "YAML text"),
        ("a: 1\n" * 300_000, "bytes"),
        ("[" * 100_000, "nested deeper"),
        ("a: [" + "1," * 200_000 + "]", "longer than"),
        ("a: 1\n---\nb: 1", "line 2"),
    ],
)
def test_what_is_no_world_file(write, data, message):
    with pytest.raises(OmnilabError, match=message):
        load_world(write(data))


def test_worlds_that_are_not_there():
    with pytest.raises(ConfigError, match=r"world='rom'.*did you mean 'room'"):
        load_world("rom")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_end_in_one_sentence(write, small, data):
    tokens = small.replace("[", " [ ").replace("]", " ] ").split(" ")
    position = data.draw(st.integers(0, len(tokens) - 1))
    junk = data.draw(
        st.sampled_from(["", "x", "-1", ".nan", "[]", "{}", "null", "true", "'", "1e999", "0x1F", "2024-01-01"])
    )
    tokens[position] = junk
    with contextlib.suppress(DataError):
        load_world(write(" ".join(tokens)))


def test_panels_hang_on_walls(write, small):
    for panel, message in [
        ("{kind: panel, wall: north, at: [1.8, 1], size: [1, 1]}", "reaches beyond its wall"),
        ("{kind: panel, wall: north, at: [0, 2.5], size: [1, 1]}", "reaches beyond its wall"),
        ("{kind: panel, wall: nord, at: [0, 1], size: [1, 1]}", "unknown wall 'nord'"),
    ]:
        with pytest.raises(DataError, match=message):
            load_world(write(small + f"  - {panel}\n"))
    with pytest.raises(DataError, match="no room comes before"):
        load_world(write("map_m: [1, 1]\nobjects:\n  - {kind: panel, wall: north, at: [0, 1], size: [1, 1]}\n"))


@pytest.mark.parametrize("wall", ["north", "east", "south", "west"])
def test_panels_face_the_room_just_before_their_wall(write, small, wall):
    world = load_world(
        write(small + f"  - {{kind: panel, wall: {wall}, at: [0.5, 1], size: [1.2, 0.8], depth_m: 0.01}}\n")
    )
    panel = world.quads[-1]
    center, normal = panel.corner + panel.u / 2 + panel.v / 2, np.cross(panel.u, panel.v)
    along = 0 if wall in {"north", "south"} else 1
    assert center[along] == pytest.approx(0.5)
    assert abs(center[1 - along]) == pytest.approx(1.99)
    assert center[2] == pytest.approx(1.4)
    towards_the_middle = -np.sign(center[1 - along])
    assert np.allclose(normal, 1.2 * 0.8 * towards_the_middle * np.eye(3)[1 - along])


def test_a_box_is_closed_and_its_front_looks_south(write):
    text = "map_m: [1, 1]\nobjects:\n  - {kind: box, at: [1, 2], z: 0.5, size: [2, 1, 3], turn_deg: 90, front: [1, 2, 3]}\n"
    world = load_world(write(text))
    normals = np.array([np.cross(face.u, face.v) for face in world.quads])
    centers = np.array([face.corner + face.u / 2 + face.v / 2 for face in world.quads])
    assert np.allclose(normals.sum(axis=0), 0)
    assert np.einsum("ij,ij->", centers, normals) / 3 == pytest.approx(
        2 * 1 * 3
    )  # Gauss: outward normals give the volume
    assert np.allclose(centers.mean(axis=0), [1, 2, 2])
    assert np.allclose(normals[0], [6, 0, 0])  # south, turned by 90 degrees, is east
    assert np.all(baked_pictures(world)[0] == [1, 2, 3])


EXAMPLES = {
    "books": "",
    "bricks": "color: [150, 80, 60]",
    "door": "color: [150, 80, 60]",
    "facade": "color: [150, 80, 60], brick_m: 0.1, bay_m: [0.7, 0.9], window_m: [0.4, 0.5]",
    "image": "file: picture.png",
    "motifs": "ground: [150, 80, 60], colors: [[9, 200, 9], [200, 9, 9]]",
    "noise": "color: [150, 80, 60]",
    "plain": "color: [150, 80, 60]",
    "poster": "ground: [150, 80, 60]",
    "sky": "clouds: 0.6",
    "stripes": "colors: [[9, 200, 9], [200, 9, 9]]",
    "tiles": "colors: [[9, 200, 9], [200, 9, 9]]",
    "window": "",
    "wood": "color: [150, 80, 60]",
}


@pytest.mark.parametrize("kind", TEXTURES)
@pytest.mark.parametrize("size", ["[1.5, 1]", "[0.01, 0.7]"])
def test_every_texture_covers_every_face_and_is_the_same_twice(write, tmp_path, kind, size):
    cv2.imwrite(str(tmp_path / "picture.png"), np.random.default_rng(0).integers(0, 255, (20, 30, 3), np.uint8))
    texture = f"textures:\n  it: {{kind: {kind}, {EXAMPLES[kind]}}}\n"
    text = f"map_m: [1, 1]\n{texture}objects:\n  - {{kind: rug, at: [0, 0], size: {size}, texture: it}}\n"
    picture = baked_pictures(load_world(write(text)))[0]
    assert np.array_equal(picture, baked_pictures(load_world(write(text + "# a comment\n")))[0])
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    if size == "[1.5, 1]":
        assert picture.shape == (128, 192, 3)
        assert (picture.std() > 8) or kind in {"plain", "sky"}


def test_seed_changes_the_textures(write, small):
    one, other = (baked_pictures(load_world(write(f"seed: {seed}\n{small}")))[0] for seed in (1, 2))
    assert np.abs(one.astype(int) - other).mean() > 3


def test_bricks_have_courses_of_their_height(write):
    text = "map_m: [1, 1]\ntexels_per_m: 200\ntextures:\n  it: {kind: bricks, color: [100, 20, 20], mortar: [250, 250, 250], "
    text += "brick_m: [0.25, 0.1], joint_m: 0.01}\nobjects:\n  - {kind: rug, at: [0, 0], size: [2, 1], texture: it}\n"
    rows = baked_pictures(load_world(write(text)))[0][..., 1].mean(axis=1)
    assert np.array_equal(np.nonzero(rows > 240)[0], [20 * i + j for i in range(10) for j in range(2)])


def test_glowing_faces_need_no_lamp(write):
    text = "map_m: [1, 1]\nlight: {ambient: 0.1, lamps: []}\ntextures:\n  it: {kind: plain, color: [250, 240, 200], glows: true}\n"
    text += (
        "objects:\n  - {kind: rug, at: [0, 0], size: [1, 1], texture: it}\n  - {kind: rug, at: [3, 0], size: [1, 1]}\n"
    )
    glowing, dark = baked_pictures(load_world(write(text)))
    assert np.all(glowing == [250, 240, 200])
    assert np.all(dark == 20)


def test_the_shipped_worlds_show_every_kind_of_object_and_are_rich_in_texture():
    used = "".join(file.read_text() for file in shipped().values())
    assert all(f"kind: {kind}," in used for kind in set(OBJECTS) - {"face", "mesh"})
    world = load_world("room")
    assert {solid.name for solid in world.solids} >= {"bookcase", "chair", "dining table", "plant", "sofa"}
    walls = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in baked_pictures(world)[:6]]
    assert [round(float(wall.std())) > 3 for wall in walls] == [True] * 6
