"""`omnilab world check`, and questions about units, axes and colours: what it says, and that its advice works."""

from __future__ import annotations

import os
import re
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from omnilab.errors import ConfigError, DataError
from omnilab_mirror import Mirror
from omnilab_mirror.commands import world_command
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world

CORNERS = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)]  # an L of 20 m²
SIDES = [(1, 2, 8, 7), (2, 3, 9, 8), (3, 4, 10, 9), (4, 5, 11, 10), (5, 6, 12, 11), (6, 1, 7, 12)]
FACES = [tuple(range(1, 7)), tuple(range(12, 6, -1)), *SIDES]


def room(up: str = "z", unit: float = 1.0, high: float = 2.5) -> str:
    """An OBJ file of an L-shaped room, closed, in units of so many metres."""
    points = [(x, y, z) for z in (0, high) for x, y in CORNERS]
    points = points if up == "z" else [(x, z, -y) for x, y, z in points]
    vertices = "".join(f"v {x / unit:.6g} {y / unit:.6g} {z / unit:.6g}\n" for x, y, z in points)
    return vertices + "".join(f"f {' '.join(map(str, face))}\n" for face in FACES)


def shelf() -> str:
    """An OBJ file of a box of 1 x 0.3 m, 2.2 m high."""
    points = "".join(f"v {x} {y} {z}\n" for z in (0, 2.2) for x, y in ((0, 0), (1, 0), (1, 0.3), (0, 0.3)))
    return points + "f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n"


@pytest.fixture
def check(capsys):
    """Runs the command and returns its exit code and what it printed."""

    def check(*argv: str) -> tuple[int, str]:
        code = world_command(["check", *argv])
        return code, capsys.readouterr().out

    return check


# ------------------------------------------------------------------------------------------------ what is in a mesh
def test_a_mesh_file_is_summarised(check, write, tmp_path):
    Image.new("RGB", (4, 4)).save(tmp_path / "there.png")
    write("newmtl a\nmap_Kd there.png\nnewmtl b\nmap_Kd gone.png\nnewmtl c\nKd 1 0 0\n", "m.mtl")
    text = "mtllib m.mtl\n" + "".join(f"v {x} {y} {z}\n" for z in (-1, 2) for x, y in CORNERS)
    text += "vt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/2 4/3\nusemtl c\n"
    text += "f 1 4 5\nf 1 5 6\n" + "".join(f"f {' '.join(map(str, face))}\n" for face in SIDES) + "f 1 1 2\n"
    code, out = check(write(text, "room.obj"))
    assert code == 0
    assert "room.obj: 16 triangles" in out
    assert "1 textures found, 1 missing" in out
    assert "extent: 6 x 6 m and 3 m high" in out
    assert "floor: at height -1 m of the file" in out
    assert re.search(r"map: 6 x 6 m, \d+% of it free at 1 m", out)
    assert "'gone.png' (No such file" in out
    assert "1 triangles without an area were left out" in out
    for nonsense in ("objects:", "texels", "add one", "warning"):
        assert nonsense not in out


def test_a_world_file_of_meshes_alone_is_summarised(check, write):
    write(room(), "room.obj")
    code, out = check(write("map_m: [6, 6]\nobjects:\n  - {kind: mesh, file: room.obj, at: [-3, -3]}\n"))
    assert code == 0
    assert "room.obj: 20 triangles" in out
    assert "no room and no area" not in out


def test_a_mesh_of_many_objects_is_read_and_described_once(check, write, monkeypatch):
    from omnilab_mirror.scene.meshes import mesh_file

    write(shelf() + "l 1 2\n", "shelf.obj")
    entries = "".join(f"  - {{kind: mesh, file: shelf.obj, at: [{i}, 0]}}\n" for i in range(5))
    code, out = check(write("map_m: [6, 6]\nobjects:\n" + entries))
    assert code == 0
    assert out.count("shelf.obj: 12 triangles") == 1
    assert out.count("points or lines were left out") == 1
    monkeypatch.setattr(mesh_file, "MAX_TRIANGLES", 40)
    code, out = check(write("map_m: [6, 6]\nobjects:\n" + entries))
    assert code == 2
    assert "object 4 is one mesh too many: 48 triangles are in the world, 40 may be" in out


def test_what_is_no_file_is_named(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    for name in ("pipe.yaml", ""):
        with pytest.raises(ConfigError, match=r"is a folder, a pipe, a device or a link to nothing; give the path"):
            load_world(str(tmp_path / name))


def test_a_mesh_without_a_level_floor_says_so(check, write):
    code, out = check(write("v 0 0 0\nv 4 0 0\nv 0 4 3\nf 1 2 3\n", "roof.obj"))
    assert code == 0
    assert "floor: at height 0 m of the file, its lowest point: nothing is level in its lower half" in out


def test_files_that_cannot_be_used_end_in_2(check, write):
    code, out = check(write("v 0 0 0\n", "a.obj"))
    assert code == 2
    assert "wrong: " in out
    assert "holds no triangles" in out


def test_huge_maps_are_counted_on_a_coarser_grid(check, write):
    code, out = check(write("v 0 0 0\nv 4999 0 0\nv 4999 4999 0\nv 0 4999 0\nf 1 2 3 4\n", "field.obj"))
    assert code == 0
    assert "100% of it free" in out


# ------------------------------------------------------------------------------------------------ units
@pytest.mark.parametrize(("unit", "name"), [(0.01, "centimetres"), (0.0254, "inches"), (0.001, "millimetres")])
def test_rooms_in_small_units_are_asked_about_and_the_advice_works(check, write, unit, name):
    file = write(room(unit=unit, high=2.7), "room.obj")
    if unit == 0.001:  # more than a world may measure
        code, out = check(file)
        assert code == 2
    else:
        code, out = check(file)
        assert code == 0
    assert f"if it is in {name}" in out
    scale = re.search(r"set sensor\.scale=([\d.]+)", out)[1]
    code, out = check(file, "--scale", scale)
    assert code == 0
    assert "extent: 6 x 6 m and 2.7 m high" in out
    assert "note" not in out
    assert Mirror(world=file, scale=float(scale))._world().map_m == pytest.approx((6, 6), rel=1e-4)


def test_rooms_in_a_larger_unit_are_asked_about(check, write):
    code, out = check(write(room(unit=100), "room.obj"))
    assert code == 0
    assert "too small, set sensor.scale=100" in out
    assert "extent: 6 x 6 m" in check(write(room(unit=100), "room.obj"), "--scale", "100")[1]


def test_a_world_file_in_centimetres_is_asked_about(check, write):
    text = "map_m: [400, 300]\ntexels_per_m: {}\nobjects:\n  - {{kind: room, size: [600, 500, 280]}}\n"
    code, out = check(write(text.format(128)))
    assert code == 2
    assert "'room' is 600 x 500 m and 280 m high" in out
    assert "in centimetres, divide all lengths of the file by 100" in out
    code, out = check(write(text.format(1)))
    assert code == 0
    assert "warning: 'room' is 600 x 500 m and 280 m high" in out
    tidy = "map_m: [4, 3]\ntexels_per_m: 32\nobjects:\n  - {kind: room, size: [6, 5, 2.8]}\n"
    assert "centimetres" not in check(write(tidy))[1]


def test_a_mesh_of_a_world_file_in_centimetres_is_asked_about_and_the_advice_works(check, write):
    write(room(unit=0.01), "room.obj")
    text = "map_m: [6, 6]\nobjects:\n  - {kind: mesh, file: room.obj, at: [0, 0]}\n"
    advice = re.search(r"'room\.obj': .* set (scale: [\d.]+)", check(write(text))[1])[1]
    assert "note" not in check(write(text.replace("at:", f"{advice}, at:")))[1]


# ------------------------------------------------------------------------------------------------ the up axis
def test_a_world_on_its_side_is_asked_about_and_the_advice_works(check, write, caplog):
    file = write(room(up="y"), "room.obj")
    with caplog.at_level("WARNING", logger="omnilab"):
        load_world(file)
    assert "may lie on its side" in caplog.text  # in a run's log, too
    out = check(file)[1]
    up = re.search(r"set sensor\.up=(\w)", out)[1]
    out = check(file, "--up", up)[1]
    assert "extent: 6 x 6 m and 2.5 m high, read with up=y" in out
    assert "note" not in out
    upright = load_world(write(room(), "upright.obj"))
    assert np.allclose(Mirror(world=file, up=up)._world().meshes[0].corners, upright.meshes[0].corners, atol=1e-5)
    assert Mirror(world=file, up=up)._world().digest != load_world(file).digest


def test_a_mesh_of_a_world_file_on_its_side_is_asked_about_and_the_advice_works(check, write):
    write(room(up="y"), "room.obj")
    text = "map_m: [6, 6]\nobjects:\n  - {kind: mesh, file: room.obj, at: [0, 0]}\n"
    advice = re.search(r"'room\.obj': .* set (up: \w)", check(write(text))[1])[1]
    assert "note" not in check(write(text.replace("at:", f"{advice}, at:")))[1]


def box(x: float, y: float, z: float, floor_only: bool = False) -> str:
    points = "".join(f"v {px} {py} {pz}\n" for pz in (0, z) for px, py in ((0, 0), (x, 0), (x, y), (0, y)))
    rest = "" if floor_only else "f 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n"
    return points + "f 1 2 3 4\n" + rest


@pytest.mark.parametrize(
    "upright",
    [
        room(),
        box(20, 1.6, 2.5),  # a corridor, higher than deep, with more wall than floor
        box(20, 2.2, 2.8),
        box(1, 1, 6),  # a column
        box(30, 20, 12),
        box(50, 60, 0, floor_only=True),
        shelf(),
    ],
)
def test_nothing_is_asked_about_what_stands(write, upright):
    assert load_world(write(upright, "upright.obj")).notes == []


def test_an_open_room_on_its_side_is_seen(write):
    text = "v 0 0 0\nv 6 0 0\nv 6 0 5\nv 0 0 5\nv 0 2.5 0\nv 6 2.5 0\nv 6 2.5 5\nv 0 2.5 5\n"
    walls = "f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
    assert (
        "if it should be 6 x 5 m and 2.5 m high, set sensor.up=y"
        in load_world(write(text + "f 1 2 3 4\n" + walls, "a.obj")).notes[0]
    )
    assert load_world(write(text + "f 1 2 3 4\n" + walls, "b.obj"), up="y").notes == []


@pytest.mark.parametrize("extent", [(6, 2.5, 6), (2.2, 2.5, 20), (40, 3, 30)])
def test_rooms_on_their_side_are_seen(write, extent):
    assert "on its side" in load_world(write(box(*extent), "lying.obj")).notes[0]


def test_up_and_scale_are_settings_of_mesh_files(write, small):
    with pytest.raises(ConfigError, match=r"up='x' is no axis"):
        Mirror(up="x")
    with pytest.raises(ConfigError, match=r"scale=0 is out of range"):
        Mirror(scale=0)
    world = write(small)
    with pytest.raises(ConfigError, match=r"up=y is of a mesh file .* 'up: y' in its entry"):
        Mirror(world=world, up="y").scene()
    with pytest.raises(ConfigError, match=r"scale=0\.01 is of a mesh file"):
        Mirror(world=world, scale=0.01).scene()


# ------------------------------------------------------------------------------------------------ colours, files
@pytest.mark.parametrize(
    ("old", "new", "larger"),
    [
        ("[220, 220, 220]", "[0.8, 0.4, 0.2]", "[204, 102, 51]"),
        ("[220, 220, 220]", "[1, 1, 1]", "[255, 255, 255]"),
        ("[220, 220, 220]", "[1.0, 0, 0]", "[255, 0, 0]"),
        ("kind: wood, color: [160, 110, 70]", "kind: wood, color: [0.6, 0.4, 0.3]", "[153, 102, 76]"),
        ("kind: wood, color: [160, 110, 70]", "kind: tiles, colors: [[200, 1, 1], [0.5, 0, 0]]", "[128, 0, 0]"),
    ],
)
def test_colours_from_0_to_1_are_refused_and_the_advice_works(write, small, old, new, larger):
    assert small.count(old) == 1
    with pytest.raises(DataError, match=rf"line \d+: .*a colour from 0 to 255: {re.escape(larger)} if this") as error:
        load_world(write(small.replace(old, new)))
    one = re.search(r"=(\[[\d., ]+\]);", str(error.value))[1]
    load_world(write(small.replace(old, re.sub(re.escape(one), larger, new.replace("1.0, 0, 0", "1.0, 0, 0")))))


def test_black_is_a_colour(write, small):
    load_world(write(small.replace("[220, 220, 220]", "[0, 0, 0]")))
    load_world(write(small.replace("[220, 220, 220]", "[0.0, 2.5, 0.0]")))


TEXTURED = "map_m: [1, 1]\ntextures:\n  it: {{kind: image, file: {}}}\nobjects:\n  - {{kind: rug, at: [0, 0], size: [1, 1], texture: it}}\n"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ('"a\\0b.png"', "NUL"),
        ("pipe.png", "a pipe or a device, no file"),
        ("folder.png", "is a folder"),
        ("loop.png", "symbolic links"),
        ("out.png", "outside the folder"),
        ("bomb.png", r"at most 40000000 pixels \(it has more than"),
        ("huge.hdr", r"at most 40000000 pixels \(it has 99999 x 99999\)"),
        ("cut.jpg", "no picture, or not all of it"),
        ("fractions.tif", "its pixels are fractions; save it with 8 or 16 bits"),
        ("program.png", "no picture"),
        ("x" * 300 + ".png", "too long"),
    ],
)
def test_pictures_that_are_no_files_or_too_large_are_refused_before_they_are_read(write, tmp_path, name, reason):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "loop.png").symlink_to("loop.png")
    (tmp_path / "out.png").symlink_to("/etc/passwd")
    head = b"IHDR" + struct.pack(">IIBBBBB", 20_000, 20_000, 1, 0, 0, 0, 0)
    head = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + head + struct.pack(">I", 0) + b"IDAT")
    (tmp_path / "huge.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n")
    (tmp_path / "program.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(x) print\n")
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)).save(tmp_path / "whole.jpg")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "whole.jpg").read_bytes()[:2000])
    Image.fromarray(np.full((4, 4), 0.5, np.float32)).save(tmp_path / "fractions.tif")
    with pytest.raises(DataError, match=rf"line 3: 'it' has file=.*{reason}") as error:
        load_world(write(TEXTURED.format(name)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "pixels"),
    [
        ("16.png", np.full((8, 8, 3), 25_700, np.uint16)),
        ("grey.png", np.full((8, 8), 25_700, np.uint16)),
        ("16.tif", np.full((8, 8, 3), 25_700, np.uint16)),
        ("8.jpg", np.full((8, 8, 3), 100, np.uint8)),
        ("linear.hdr", np.full((8, 8, 3), 100 / 255, np.float32)),
    ],
)
def test_pictures_of_other_depths_are_as_bright_as_they_were(write, tmp_path, name, pixels):
    cv2.imwrite(str(tmp_path / name), pixels)
    picture = baked_pictures(load_world(write("light: {ambient: 1}\n" + TEXTURED.format(name))))[0]
    assert np.abs(picture.astype(int) - 100).max() <= 1


@pytest.mark.parametrize(
    ("angle", "meant"), [(1.5708, "90"), (-1.571, "-90"), (3.1416, "180"), (4.712, "270"), (90, None), (2, None)]
)
def test_turns_in_radians_are_asked_about(check, write, small, angle, meant):
    out = check(write(small.replace("at: [0.8, 0.8]", f"at: [0.8, 0.8], turn_deg: {angle}")))[1]
    assert ("in radians" in out) == (meant is not None)
    assert not meant or f"'crate' has turn_deg={angle:.4g}; if that is in radians, write {meant}" in out


@pytest.mark.parametrize(
    ("name", "reason"), [('"a\\0.obj"', "NUL"), ("pipe.obj", "a pipe or a device, no file|cannot be read")]
)
def test_meshes_that_are_no_files_are_refused(write, tmp_path, name, reason):
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(DataError, match=f"line 3: object 1 has .*({reason})"):
        load_world(write(f"map_m: [1, 1]\nobjects:\n  - {{kind: mesh, file: {name}, at: [0, 0]}}\n"))


def test_a_grid_of_too_many_nodes_is_refused(write):
    from omnilab.api import GridPoses

    file = write("v 0 0 0\nv 4999 0 0\nv 4999 4999 0\nv 0 4999 0\nf 1 2 3 4\n", "field.obj")
    with pytest.raises(ConfigError, match=r"nodes of a grid of .* GB are free; give a larger step_m"):
        Mirror(world=file).plan(GridPoses(step_m=0.1))
