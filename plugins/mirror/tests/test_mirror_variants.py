"""Variants, paths, the command `omnilab world`, and the worlds that are shipped."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import NamedPath, RandomPoses
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.runner.cli import main
from omnilab_mirror import Mirror
from omnilab_mirror.lint import warnings_of
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.objects import OBJECTS
from omnilab_mirror.scene.paths import Route
from omnilab_mirror.scene.shipped import shipped
from omnilab_mirror.scene.textures.procedural import TEXTURES
from omnilab_mirror.scene.world_yaml import Section

DOCS = (Path(__file__).parents[3] / "docs" / "worlds.md").read_text(encoding="utf-8")
VARIED = """\
map_m: [2, 2]
texels_per_m: 32
light:
  ambient: 0.5
  lamps:
    - {name: left, at: [-1, 0, 2]}
    - {name: right, at: [1, 0, 2]}
textures:
  boards: {kind: wood, color: [160, 110, 70]}
  cloth: {kind: noise, color: [60, 110, 170]}
objects:
  - {kind: room, size: [4, 4, 3], floor: boards, north: boards, east: cloth}
  - {kind: box, name: crate, at: [0.8, 0.8], size: [0.4, 0.4, 0.5], texture: boards}
  - {kind: box, name: chest, at: [-0.8, 0.8], size: [0.4, 0.4, 0.5], texture: cloth}
  - {kind: rug, at: [0, 0], size: [1, 1], texture: cloth}
variants:
  one lamp: {remove: [left]}
  dark: {light: {ambient: 0.1, lamps: []}}
  gone: {remove: [crate]}
  blue: {change: {crate: {texture: cloth, at: [0.2, 0.8]}, right: {power: 0}}}
  more: {add: [{kind: box, name: parcel, at: [0, -1], size: [0.2, 0.2, 0.2]}]}
"""


# ------------------------------------------------------------------------------------------------------------ variants
def test_variants_change_what_they_name_and_nothing_else(write):
    file = write(VARIED.replace("ambient: 0.5", "ambient: 0.5\n  shadows: false"))
    plain = load_world(file)
    assert plain.variants == ("one lamp", "dark", "gone", "blue", "more")
    assert [lamp.name for lamp in load_world(file, "one lamp").light.lamps] == ["right"]
    dark = load_world(file, "dark").light
    assert (dark.ambient, dark.lamps, dark.shadows) == (0.1, [], False)
    gone, more = load_world(file, "gone"), load_world(file, "more")
    assert {solid.name for solid in gone.solids} == {"chest"}
    assert {solid.name for solid in more.solids} == {"crate", "chest", "parcel"}
    before = {face.seed: picture for face, picture in zip(plain.quads, baked_pictures(plain), strict=True)}
    for face, picture in zip(gone.quads, baked_pictures(gone), strict=True):
        assert np.array_equal(picture, before[face.seed])  # the rug, too, which comes after the crate
    blue = load_world(file, "blue")
    assert blue.solids[0].place.at[0] == 0.2
    assert [lamp.power for lamp in blue.light.lamps] == [1.0, 0.0]


def test_variants_are_part_of_the_images_names(write):
    file = write(VARIED)
    layout = RandomPoses(3, seed=1)
    keys = [Mirror(world=file, variant=variant).plan(layout).keys[0] for variant in (None, "dark", "gone")]
    assert len(set(keys)) == 3
    images = [
        next(Mirror(world=file, variant=v, size=32).frames(Mirror(world=file).plan(layout))).images
        for v in (None, "dark")
    ]
    assert images[0].mean() > 2 * images[1].mean()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("remove: [left]", "remove: [lift]", "line 17: 'one lamp' names 'lift', .* did you mean 'left'"),
        ("change: {crate", "change: {crete", "names 'crete'.*did you mean 'crate'"),
        ("{remove: [left]}", "{remove: left}", "remove='left'; expected a list of names"),
        ("{remove: [left]}", "{removed: [left]}", "unknown key 'removed'; did you mean 'remove'"),
        ("crate: {texture: cloth", "crate: {texture: clot", "line 20: object 2 has an unknown texture 'clot'"),
        ("{ambient: 0.1", "{ambient: -1", "line 18: .*ambient=-1"),
    ],
)
def test_mistakes_in_variants_are_reported_with_their_line(write, old, new, message):
    file = write(VARIED.replace(old, new))
    variants = load_world(file).variants  # without them, it is used
    with pytest.raises(DataError, match=message):
        [load_world(file, variant) for variant in variants]


def test_a_variant_that_is_not_there(write):
    with pytest.raises(ConfigError, match=r"variant='evning' .* there is evening, .*did you mean evening\?"):
        Mirror(variant="evning").plan(RandomPoses(1, seed=1))


# --------------------------------------------------------------------------------------------------------------- paths
@given(seed=st.integers(0, 10**6), count=st.integers(2, 8), closed=st.booleans())
def test_paths_are_evenly_spaced_and_lie_on_their_lines(seed, count, closed):
    points = np.random.default_rng(seed).uniform(-5, 5, (count, 2))
    route = Route(points, 0.05, closed, 0.25)
    T = route.poses(1.2)
    corners = np.concatenate([points, points[:1]]) if closed else points
    length = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    assert route.length_m == pytest.approx(length)
    assert len(T) == max(1, round(length / 0.05)) + (not closed)
    assert np.allclose(T[0, :3, 3], [*points[0], 1.2])
    step = np.linalg.norm(np.diff(T[:, :2, 3], axis=0), axis=1)
    assert step.max() < 0.055  # a corner makes the path shorter, never longer
    assert np.median(step) == pytest.approx(length / max(1, round(length / 0.05)), rel=1e-6) or count > 4


def test_a_square_is_driven_counter_clockwise_with_turns_around_its_corners():
    route = Route(np.array([[0, 0], [3, 0], [3, 3], [0, 3.0]]), 0.1, closed=True, turn_m=0.25)
    T = route.poses(1.0)
    assert len(T) == 120
    heading = heading_of(T)
    straight = np.min([np.abs(np.arange(120) / 10 - corner) for corner in range(0, 13, 3)], axis=0) > 0.26
    assert np.allclose(wrap_angle(heading[straight] - np.pi / 2 * (np.arange(120) // 30)[straight]), 0, atol=1e-9)
    assert heading[30] == pytest.approx(np.pi / 4)
    turns = wrap_angle(np.diff(np.append(heading, heading[0])))
    assert turns.sum() == pytest.approx(2 * np.pi)
    assert turns.max() < np.deg2rad(35)


@pytest.mark.parametrize(
    ("world", "path", "count"), [("room", "square", 189), ("corridor", "route", 783), ("storey", "round", 926)]
)
def test_the_thesis_s_paths_have_their_images_and_are_free(world, path, count):
    plan = Mirror(world=world).plan(NamedPath(path))
    assert len(plan) == count
    assert (plan.T_world_camera[:, 2, 3] == 1).all()
    assert not any(obstacles(load_world(world), plan.T_world_camera[:, :3, 3], on_floor=True))
    raised = Mirror(world=world).plan(NamedPath(path, height_m=1.3))
    assert (raised.T_world_camera[:, 2, 3] == 1.3).all()


def test_paths_that_are_not_there(write):
    with pytest.raises(DataError, match=r"path 'squar'; there is square \(did you mean square\?\)"):
        Mirror().plan(NamedPath("squar"))
    for path, message in [
        ("{points: [[0, 0]], step_m: 1}", "at least 2 points"),
        ("{points: [[0, 0], [0, 0]], step_m: 1}", "no two the same in a row"),
        ("{points: [[0, 0], [1, 0], [0, 0]], step_m: 1, closed: true}", "without its first point at the end"),
        ("{points: [[0, 0, 0], [1, 0, 0]], step_m: 1}", r"list of points \[x, y\]"),
        ("{points: [[0, 0], [1, 0]]}", "lacks the key 'step_m'"),
    ]:
        with pytest.raises(DataError, match=message):
            load_world(write(f"{VARIED}paths:\n  it: {path}\n"))


# --------------------------------------------------------------------------------------------------- worlds, the command
@pytest.mark.parametrize("name", shipped())
def test_shipped_worlds_are_sound_in_all_variants(name):
    for variant in (None, *load_world(name).variants):
        world = load_world(name, variant)
        assert len(world.quads) < 1000
        warnings = list(warnings_of(world))
        if (name, variant) == ("corridor", "doors closed"):
            route, two_rooms = warnings
            assert re.match(r"path 'route': 10 of 783 .* inside 'door'", route)
            assert re.match(r"path 'two_rooms': 12 of 891 .* inside 'door'", two_rooms)
        else:
            assert not warnings


def command(capsys, *argv):
    with pytest.raises(SystemExit) as end:
        main(["world", *argv])
    return end.value.code, capsys.readouterr()


@pytest.mark.slow
def test_the_command_tells_what_is_in_a_world(capsys):
    code, out = command(capsys, "check", "room")
    assert code == 0
    assert "room: 10 x 8 m, 3 m high" in out.out
    assert "path square: 12.00 m, 189 images" in out.out
    assert "3 bookcase" in out.out
    assert "wrong" not in out.out + out.err
    assert all(
        name in command(capsys, "list")[1].out for name in ("corridor", "office", "plain", "room", "square", "storey")
    )


def test_the_command_tells_everything_that_is_wrong_at_once(capsys, write):
    text = (
        VARIED.replace("kind: noise", "kind: nois").replace("size: [1, 1]", "size: [0, 1]").replace("[left]", "[lift]")
    )
    code, out = command(capsys, "check", write(text))
    wrong = [line for line in out.out.splitlines() if line.startswith("wrong")]
    assert code == 2
    assert [re.search(r"line (\d+)", line)[1] for line in wrong] == ["10", "15", "17"]
    code, out = command(capsys, "check", write("- no\n- mapping"))
    assert code == 2
    assert "mapping" in out.out + out.err


@pytest.mark.parametrize(
    ("old", "new", "warning"),
    [
        ("{kind: room, size: [4, 4, 3], floor: boards, north: boards, east: cloth}", "{kind: rug, name: floor, at: [3, 0], size: [2, 2]}", "no room and no area"),
        ("map_m: [2, 2]", "map_m: [5, 2]", "map_m is 5 m in x, from -2.5 to 2.5, but there is floor from -2 to 2 only"),
        ("at: [-1, 0, 2]", "at: [-0.8, 0.8, 0.2]", "the lamp 'left' .* is inside 'chest'"),
        ("at: [0.8, 0.8]", "at: [2, 0.8]", "'crate' sticks through a wall, near"),
        ("at: [0.8, 0.8]", "at: [7, 0.8]", "'crate' lies outside every room"),
        ("at: [0.8, 0.8]", "at: [-0.6, 0.8]", "faces of 'crate' and 'chest' lie in one plane near"),
        ("variants:", "paths:\n  it: {points: [[-1.5, 0.8], [0, 0.8]], step_m: 0.1}\nvariants:", r"path 'it': 5 of 16 images .*\(-1.00, 0.80\), .* 'chest'"),
        ("- {kind: rug", "- {kind: wall, from: [0, 0.8], to: [1, 0.8], height: 1}\n  - {kind: rug", "'crate' at .* sticks into a wall"),
        ("ambient: 0.5\n  lamps:\n    - {name: left, at: [-1, 0, 2]}\n    - {name: right, at: [1, 0, 2]}", "ambient: 0", "everything is black"),
    ],
)  # fmt: skip
def test_what_can_be_rendered_but_was_hardly_meant_is_reported(write, old, new, warning):
    assert old in VARIED
    assert not list(warnings_of(load_world(write(VARIED))))
    found = list(warnings_of(load_world(write(VARIED.replace(old, new)))))
    assert len(found) == 1
    assert re.search(warning, found[0]), found


# ----------------------------------------------------------------------------------------------------------- documents
def test_the_reference_names_every_kind_and_every_key(monkeypatch, tmp_path):
    requested: set[tuple[str, str]] = set()
    value = Section.value

    def noted(self, key, *default):
        if "kind" in self and isinstance(kind := value(self, "kind"), str):
            requested.add((kind if self.title.startswith(("object", "added")) else f"texture {kind}", key))
        return value(self, key, *default)

    monkeypatch.setattr(Section, "value", noted)
    for name, file in shipped().items():
        copy = tmp_path / f"{name}.yaml"
        copy.write_text(file.read_text() + "# read anew\n")
        load_world(str(copy))
    objects, textures = DOCS.split("## Textures")
    common = {"kind", "name", "glows"}
    checked = set()
    for kind, key in requested:
        kind_, part = kind.removeprefix("texture "), textures if kind.startswith("texture ") else objects
        row = re.search(rf"^\| `{kind_}` \|(.*)\|$", part, flags=re.MULTILINE)
        assert row, f"docs/worlds.md has no row for {kind}"
        assert key in common or f"`{key}`" in row[1], f"docs/worlds.md does not name {key} of {kind}"
        checked.add(kind)
    assert set(OBJECTS) - {"face", "mesh"} | {f"texture {kind}" for kind in TEXTURES} - {"texture image"} <= checked | {
        "texture books"
    }
    assert "| `image` |" in textures
    assert "| `face` |" in objects
    assert "| `mesh` |" in objects


def test_the_reference_s_example_is_a_world(write):
    (example,) = re.findall(r"```yaml\n(.*?)```", DOCS, flags=re.DOTALL)
    file = write(example)
    for variant in (None, "dark"):
        assert not list(warnings_of(load_world(file, variant)))
