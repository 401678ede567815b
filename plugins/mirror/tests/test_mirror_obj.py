"""OBJ files in the dialects of many programs give the areas, places and colours that were written."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from omnilab.errors import DataError
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.meshes import obj as obj_module
from omnilab_mirror.scene.meshes.mesh_file import MeshFile, read_mesh
from omnilab_mirror.scene.meshes.mesh_materials import GREY

SQUARE = "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\n"
PLACES = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)  # red, green above blue, yellow


@pytest.fixture
def read(tmp_path):
    """Writes a file and others beside it, and reads it."""

    def read(content: str | bytes, **beside: str | bytes | np.ndarray) -> MeshFile:
        for name, data in beside.items():
            path = tmp_path / name.replace("__", " ").replace("_", ".")
            if isinstance(data, np.ndarray):
                Image.fromarray(data).save(path)
            else:
                path.write_bytes(data if isinstance(data, bytes) else data.encode())
        (tmp_path / "a.obj").write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_mesh(tmp_path / "a.obj")

    return read


# ------------------------------------------------------------------------------------------------ dialects
CORNERS = {"v": "{0}", "v/vt": "{0}/{1}", "v//vn": "{0}//1", "v/vt/vn": "{0}/{1}/1", "v/": "{0}/", "v/0/0": "{0}/0/0"}


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_faces_written_in_any_dialect_are_the_same(area, tmp_path, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    lines, total, points, count = [], 0.0, [], 0
    style = CORNERS[data.draw(st.sampled_from(list(CORNERS)))]
    backwards, number = data.draw(st.booleans()), data.draw(st.sampled_from(["{:.6f}", "{:+.5e}", "{:.6g}"]))
    lines.append("vn 0 0 1")
    for k in range(data.draw(st.integers(1, 5))):
        n = int(rng.integers(3, 8))
        angle = np.arange(n) * 2 * np.pi / n
        radius = rng.uniform(0.5, 1.5, n)  # stars around their middle: convex or not
        shape = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, float(k))])
        shape = np.array([[float(number.format(x)) for x in point] for point in shape])
        total += abs(np.cross(shape, np.roll(shape, -1, 0))[:, 2].sum()) / 2
        points.append(shape)
        lines += ["v " + " ".join(number.format(x) for x in point) for point in shape]
        lines += ["vt 0.5 0.5" for _ in shape]
        index = [i - n if backwards else count + 1 + i for i in range(n)]
        lines.append("f " + " ".join(style.format(i, i) for i in index))
        lines.append(data.draw(st.sampled_from(["", "# a comment", "o thing", "g part", "s off", "usemtl none"])))
        count += n
    text = "\n".join(lines) + "\n"
    text = text.replace(" ", data.draw(st.sampled_from([" ", "\t", "  "])))
    if data.draw(st.booleans()):
        text = text.replace("\nf", " # inline\nf").replace("\nv", "\n  v")
    if data.draw(st.booleans()):
        lines = [line if "#" in line else "\\\n ".join(line.rsplit(maxsplit=1)) for line in text.splitlines()]
        text = "\n".join(lines) + "\n"
    text = text.replace("\n", data.draw(st.sampled_from(["\n", "\r\n", "\r"])))
    prefix = data.draw(st.sampled_from([b"", b"\xef\xbb\xbf", b"# f\xfcr R\xe4ume\n"]))
    (tmp_path / "a.obj").write_bytes(prefix + text.encode())
    obj = read_mesh(tmp_path / "a.obj")
    assert area(obj) == pytest.approx(total, rel=1e-5)
    every = np.concatenate(points)
    assert np.allclose(obj.triangles.bounds, [every.min(0), every.max(0)], atol=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        b"\xef\xbb\xbf" + (SQUARE + "f 1 2 3 4\n").encode(),
        "v\t0 0 0\nv 4\t0 0\nv 4 3 0\nv 0 3 0\nf\t1\t2 3\nf 1 3 4",
        SQUARE.replace("v 4 0 0", "v 4 0 0 1.0") + "f 1 2 3 4",  # a weight
        SQUARE + "f 1 2 \\\n3 4\n",
        SQUARE + "f 1 2 3 4 # the floor\n",
        SQUARE + "fo 1 2 3 4\n",
        "f 1 2 3 4\n" + SQUARE,
        SQUARE.replace("\n", "\r") + "f -4 -3 -2 -1\r",
        b"# caf\xe9\n" + (SQUARE + "o caf\u00e9\nf 1 2 3 4").encode("latin-1"),
    ],
)
def test_one_square(area, shown, read, text):
    mesh = read(text)
    assert area(mesh) == pytest.approx(12)
    assert mesh.triangles.bounds.tolist() == [[0, 0, 0], [4, 3, 0]]
    assert mesh.notes == []
    assert shown(mesh) == [GREY]


def test_files_are_read_in_chunks(read, monkeypatch):
    whole = read(SQUARE + "f 1 2 3 4\n" * 5 + "f -1 -2 \\\n-3\n")
    for size in range(1, 60):
        monkeypatch.setattr(obj_module, "CHUNK", size)
        assert np.array_equal(
            read(SQUARE + "f 1 2 3 4\n" * 5 + "f -1 -2 \\\n-3\n").triangles.corners, whole.triangles.corners
        )


def test_a_concave_floor_of_20_square_metres_has_20(area, read):
    corners = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)]
    assert area(read("".join(f"v {x} {y} 0\n" for x, y in corners) + "f 1 2 3 4 5 6\n")) == 20


def test_names_are_of_objects_and_materials(read):
    mesh = read(
        "mtllib m.mtl\n" + SQUARE + "o caf\u00e9\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n", m_mtl="newmtl a\nnewmtl b\n"
    )
    assert sorted(mesh.triangles.names) == ["caf\u00e9_a", "caf\u00e9_b"]


# ------------------------------------------------------------------------------------------------ colours
RED = "newmtl red\nKd 1 0 0\n"
USED = SQUARE + "usemtl red\nf 1 2 3 4\n"


@pytest.mark.parametrize(
    ("lines", "files"),
    [
        ("mtllib m.mtl\n", {"m_mtl": RED}),
        ("mtllib other.mtl m.mtl\n", {"m_mtl": RED, "other_mtl": "newmtl b\n"}),
        ("mtllib other.mtl\nmtllib m.mtl\n", {"m_mtl": RED, "other_mtl": "newmtl b\n"}),
        ("mtllib my__room.mtl\n".replace("__", " "), {"my__room_mtl": RED}),
        ('mtllib "my room.mtl"\n', {"my__room_mtl": RED}),
        ("mtllib .\\m.mtl\n", {"m_mtl": RED}),
        ("\tmtllib\tm.mtl \r\n", {"m_mtl": RED}),
        ("mtllib m.mtl\n", {"m_mtl": "\ufeff" + RED}),
        ("mtllib m.mtl\n", {"m_mtl": b"# f\xfcr R\xe4ume\n" + RED.encode()}),
        ("mtllib m.mtl\n", {"m_mtl": RED.replace(" ", "\t").replace("\n", "\r\n")}),
        ("mtllib m.mtl\n", {"m_mtl": "newmtl red\n  kd 1.0 0.0 0.0 # light\n  Ka 0 0 0\n  illum 2\n"}),
    ],
)
def test_materials_are_found(shown, read, lines, files):
    mesh = read(lines + USED, **files)
    assert shown(mesh) == [(255, 0, 0)]
    assert mesh.notes == []


def test_names_in_latin_1_are_matched(shown, read):
    mesh = read(b"mtllib m.mtl\n" + (SQUARE + "usemtl gr\u00fcn\nf 1 2 3 4\n").encode("latin-1"),
                m_mtl="newmtl gr\u00fcn\nKd 0 1 0\n".encode("latin-1"))  # fmt: skip
    assert shown(mesh) == [(0, 255, 0)]


@pytest.mark.parametrize(
    ("material", "color", "note"),
    [
        ("Kd 255 0 0", (255, 0, 0), "go above 1 and were read as 0 to 255"),
        ("Kd 1.01 0 0", (255, 0, 0), "1 colours below 0, above their largest"),
        ("Kd -1 0 1", (0, 0, 255), "1 colours below 0"),
        ("Kd 0.2", (51, 51, 51), None),
        ("Kd spectral file.rfl", GREY, "1 colours of materials"),
        ("Kd nan 0 1", (0, 0, 255), "not a number"),
        ("Kd 1 0 0\nd 0.5", (255, 0, 0), "1 materials are transparent"),
        ("Kd 1 0 0\nTr 0.5", (255, 0, 0), "1 materials are transparent"),
        ("Kd 1 0 0\nd 1.0\nTr 0", (255, 0, 0), None),
        ("", GREY, None),
    ],
)
def test_colours_of_materials(shown, read, material, color, note):
    mesh = read("mtllib m.mtl\n" + USED, m_mtl=f"newmtl red\n{material}\n")
    assert shown(mesh) == [color]
    assert (note is None and mesh.notes == []) or (note and len(mesh.notes) == 1 and note in mesh.notes[0])


def test_materials_that_are_nowhere_are_named(read):
    assert "1 materials are in none of its .mtl files, grey stands in: red" in read(USED).notes[0]
    mesh = read("mtllib gone.mtl\n" + USED)
    assert mesh.notes == ["1 textures or materials are missing, grey stands in: 'gone.mtl' (No such file or directory)"]
    mesh = read("mtllib m.mtl\n" + USED, m_mtl=RED.encode("utf-16"))
    assert "'m.mtl' (it is UTF-16; save it as UTF-8 text)" in mesh.notes[0]


@pytest.mark.parametrize(
    ("map_kd", "color", "note"),
    [
        ("four.png", [(0, 0, 255), (0, 255, 0), (255, 0, 0), (255, 255, 0)], None),
        ("-o 0.5 0 four.png", None, None),
        ("-s 0.0001 0.0001 1 four.png", [(0, 0, 255)], None),  # the lower left corner
        ("-s 0.0001 0.0001 -o 0.9 0.9 four.png", [(0, 255, 0)], None),  # and the upper right
        ("-blendu on -bm 0.3 -s 0.0001 0.0001 four.png", [(0, 0, 255)], None),
        ("-clamp on -s 0.0001 0.0001 four.png", [(0, 0, 255)], "1 textures that end at their edges"),
        ("-s 0.0001 0.0001 my four.png", [(0, 0, 255)], None),
        ('"my four.png"', None, None),
        ("MY.PNG", [GREY], "'MY.PNG' (No such file"),
    ],
)
def test_textures_of_materials(shown, read, map_kd, color, note):
    mesh = read(
        "mtllib m.mtl\n" + SQUARE + PLACES + "v 2 1.5 0\nvt 0.5 0.5\nusemtl red\nf 1/1 2/2 5/5\nf 2/2 3/3 5/5\nf 3/3 4/4 5/5\nf 4/4 1/1 5/5\n",
        m_mtl=f"newmtl red\nmap_Kd {map_kd}\n", four_png=np.kron(FOUR, np.ones((8, 8, 1), np.uint8)), my__four_png=FOUR,
    )  # fmt: skip
    if color == [(0, 0, 255), (0, 255, 0), (255, 0, 0), (255, 255, 0)]:
        assert set(shown(mesh)) <= set(color)
    elif color:
        assert shown(mesh) == color
    assert (note is None and mesh.notes == []) or (note and len(mesh.notes) == 1 and note in mesh.notes[0])


def test_a_texture_without_places_is_said(shown, read):
    mesh = read("mtllib m.mtl\n" + SQUARE + PLACES + "usemtl red\nf 1/1 2/2 3/3\nf 1 3 4\n",
                m_mtl="newmtl red\nKd 1 0 1\nmap_Kd blue.png\n", blue_png=np.full((2, 2, 3), (0, 0, 255), np.uint8))  # fmt: skip
    assert shown(mesh) == [(0, 0, 255), (255, 0, 255)]
    assert any("1 triangles have a texture but no texture coordinates" in note for note in mesh.notes)
    assert any("1 materials have a colour (Kd) beside their texture" in note for note in mesh.notes)


@pytest.mark.parametrize("colors", ["1 0 0.2", "255 0 51", "1 0 0.2 1"])
def test_colours_of_vertices_in_both_units(shown, read, colors):
    mesh = read("".join(f"{line} {colors}\n" for line in SQUARE.splitlines()) + "f 1 2 3 4\n")
    assert shown(mesh) == [(255, 0, 51)]
    assert len(mesh.notes) == (colors == "255 0 51")


def test_a_dark_part_of_a_file_from_0_to_255_stays_dark(shown, read):
    dark = "".join(f"v {x} 0 0 1 1 1\n" for x in (0, 1)) + "v 0 1 0 1 1 1\n"
    light = "".join(f"v {x} 0 5 200 200 200\n" for x in (0, 1)) + "v 0 1 5 200 200 200\n"
    assert shown(read(dark + light + "o a\nf 1 2 3\no b\nf 4 5 6\n")) == [(1, 1, 1), (200, 200, 200)]


def test_vertices_with_and_without_colours(shown, read):
    mesh = read(SQUARE.replace("v 4 3 0", "v 4 3 0 1 0 0") + "v 9 9 9 0 0 1\nf 1 2 4\n")
    assert shown(mesh) == [GREY]


# ------------------------------------------------------------------------------------------------ other pictures
@pytest.mark.parametrize(
    ("pixels", "mode", "name", "color", "note"),
    [
        (np.full((4, 4), 25_700, np.uint16), None, "t.png", (100, 100, 100), None),  # 16 bits
        (np.full((4, 4), 100, np.uint8), None, "t.png", (100, 100, 100), None),
        (np.full((4, 4, 4), (100, 100, 100, 255), np.uint8), None, "t.png", (100, 100, 100), None),
        (np.full((4, 4, 2), (100, 255), np.uint8), "LA", "t.png", (100, 100, 100), None),
        (np.full((4, 4), True), None, "t.png", (255, 255, 255), None),
        (np.full((4, 4), 0.5, np.float32), None, "t.tif", GREY, "its pixels are fractions; save it with 8 or 16 bits"),
        (np.full((4, 4), 25_700, np.uint16), None, "t.tif", (100, 100, 100), None),
        (np.full((4, 4), 1606, np.uint16), None, "t.png", (6, 6, 6), "1 textures have 16 bits and use 12 or fewer"),
        (np.full((4, 4, 3), 25_700, np.uint16), "cv2", "t.png", (100, 100, 100), None),
        (np.full((4, 4, 3), 25_700, np.uint16), "cv2", "t.tif", (100, 100, 100), None),
    ],
)
def test_pictures_of_other_depths(shown, read, tmp_path, pixels, mode, name, color, note):
    if mode == "cv2":
        cv2.imwrite(str(tmp_path / name), pixels)
    elif mode:
        Image.merge(mode, [Image.fromarray(pixels[..., i]) for i in range(2)]).save(tmp_path / name)
    else:
        Image.fromarray(pixels).save(tmp_path / name)
    mesh = read(
        "mtllib m.mtl\n" + SQUARE + PLACES + "usemtl red\nf 1/1 2/2 3/3 4/4\n", m_mtl=f"newmtl red\nmap_Kd {name}\n"
    )
    assert shown(mesh) == [color]
    assert (note is None and mesh.notes == []) or (note and note in mesh.notes[0])


def test_an_exif_orientation_is_said(read, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(np.full((8, 4, 3), 100, np.uint8)).save(tmp_path / "t.jpg", exif=exif)
    mesh = read(
        "mtllib m.mtl\n" + SQUARE + PLACES + "usemtl red\nf 1/1 2/2 3/3 4/4\n", m_mtl="newmtl red\nmap_Kd t.jpg\n"
    )
    assert "1 textures have an EXIF orientation" in mesh.notes[0]


# ------------------------------------------------------------------------------------------------ what is wrong, and said
@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (SQUARE + "f 0 1 2\n", r"line 5: a face has the index 0, and indices start at 1"),
        (SQUARE + "f 1 2 3\nf 1 2 5\n", r"line 6: there is no vertex 5, only 4"),
        (SQUARE + "f 1 2 -5\n", r"line 5: a face has the index 0"),
        (SQUARE + "vt 0 0\nf 1/1 2/1 3/2\n", r"line 6: there is no texture coordinate 2, only 1"),
        (SQUARE + "f 1 2 x\n", r"line 5 has '1 2 x' instead of corners such as"),
        (SQUARE + "f 1 2 3.5\n", r"line 5 has '1 2 3\.5' instead of corners"),
        (SQUARE + "f 1/1/1/1 2 3\n", r"line 5 has .* instead of corners"),
        (SQUARE + "f 1 2 99999999999999999999\n", r"line 5 has .* instead of corners"),
        ("v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"line 1 has '0 0' instead of 3 coordinates"),
        ("v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"line 1 has '0 0 zero' instead of 3 coordinates"),
        ("v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"line 1 has '0,5 0 0' instead of 3 coordinates"),
        (SQUARE + "vt x\nf 1/1 2/1 3/1\n", r"line 5 has 'x' instead of 1 to 3 texture coordinates"),
        ("v 1e13 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 3\n", r"a corner at 1e\+13, up to 1e\+12 is read"),
        ("v 1e39 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 3\n", "NaN or infinite"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(read, text, sentence):
    with pytest.raises(DataError, match=sentence) as error:
        read(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_named(read, encoding):
    with pytest.raises(DataError, match=r"UTF-16 or binary.*save it as UTF-8 text"):
        read((SQUARE + "f 1 2 3 4\n").encode(encoding))


@pytest.mark.parametrize(
    ("more", "note"),
    [
        ("l 1 2\np 1\n", "2 points or lines were left out"),
        ("f 1 2\nf 1\n", "2 faces of fewer than three corners were left out"),
        ("cstype bezier\nsurf 0 1 0 1 1 2 3\n", "1 free-form curves or surfaces were left out"),
        ("hello world\n", "1 lines of unknown kinds were left out"),
        ("f 1 1 2\n", "1 triangles without an area were left out"),
        ("f 1 3 2 4\n", "1 polygons that cross themselves were read as fans of triangles"),
        (
            "vt nan 0\nvt 1e30 0\nvt 0 0\nusemtl red\nf 1/1 2/2 3/3\n",
            "1 triangles have texture coordinates that are NaN",
        ),
    ],
)
def test_what_is_left_out_is_counted(read, more, note):
    mesh = read("mtllib m.mtl\n" + SQUARE + more + "f 1 2 3 4\n", m_mtl="newmtl red\nmap_Kd t.png\n", t_png=FOUR)
    assert any(note in found for found in mesh.notes) if note else mesh.notes == []


def test_a_mesh_on_a_map_keeps_its_millimetres(read, tmp_path):
    corners = [(450_000.125, 5_400_000.25), (450_004.125, 5_400_000.25), (450_004.125, 5_400_003.375)]
    text = "".join(f"v {x} {y} 512.5\n" for x, y in corners) + "f 1 2 3\n"
    mesh = read(text)
    assert np.allclose(np.ptp(mesh.triangles.corners[0], axis=0), [4, 3.125, 0], atol=1e-6)
    assert np.allclose(mesh.triangles.bounds[0] + mesh.origin, [450_000.125, 5_400_000.25, 512.5])
    world = load_world(str(tmp_path / "a.obj"))
    assert np.allclose(world.meshes[0].bounds, [[-2, -1.5625, 0], [2, 1.5625, 0]], atol=1e-5)
    assert "floor: at height 512.5 m of the file" in world.contents
    near = "map_m: [4, 4]\nobjects:\n  - {kind: mesh, file: a.obj, at: [-450000, -5400000], z: -512}\n"
    (tmp_path / "w.yaml").write_text(near)
    assert np.allclose(
        load_world(str(tmp_path / "w.yaml")).meshes[0].bounds, [[0.125, 0.25, 0.5], [4.125, 3.375, 0.5]], atol=1e-5
    )


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"ply\nformat ascii 1.0\n", "is a PLY file, by its first bytes; give it the ending .ply"),
        (b"glTF\2\0\0\0", "is a GLB file, by its first bytes; give it the ending .glb"),
        (b"solid cube\n", "is an STL file, by its first bytes; convert it"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "is a pointer of Git LFS, .* 'git lfs pull'"),
        (b"\x1f\x8b\x08", "is compressed by gzip, by its first bytes; unpack it"),
    ],
)
def test_files_of_another_kind_are_named(read, data, sentence):
    with pytest.raises(DataError, match=sentence):
        read(data)


def test_a_file_whose_name_has_other_cases_is_named(read, tmp_path):
    (tmp_path / "maps").mkdir()
    Image.new("RGB", (1, 1)).save(tmp_path / "maps/Wood.PNG")
    mesh = read(
        "mtllib m.mtl\n" + SQUARE + PLACES + "usemtl red\nf 1/1 2/2 3/3\n",
        m_mtl="newmtl red\nmap_Kd textures/wood.png\n",
    )
    assert "(No such file or directory; there is 'maps/Wood.PNG')" in mesh.notes[0]


def test_transparent_pictures_are_said(read, tmp_path):
    for alpha, count in ((255, 0), (100, 1)):
        Image.new("RGBA", (2, 2), (9, 8, 7, alpha)).save(tmp_path / "t.png")
        mesh = read(
            "mtllib m.mtl\n" + SQUARE + PLACES + "usemtl red\nf 1/1 2/2 3/3\n", m_mtl="newmtl red\nmap_Kd t.png\n"
        )
        assert len(mesh.notes) == count
        assert not count or "1 textures are transparent in parts" in mesh.notes[0]


def test_textures_far_outside_do_not_end_the_viewer_s_mesh(read, tmp_path):
    from omnilab_mirror import Mirror

    for u in ("-1e-9", "nan", "1e38", "inf", "999999"):
        read("mtllib m.mtl\n" + SQUARE + f"vt {u} {u}\nusemtl red\nf 1/1 2/1 3/1 4/1\n",
             m_mtl="newmtl red\nmap_Kd t.png\n", t_png=FOUR)  # fmt: skip
        assert len(Mirror(world=str(Path(tmp_path / "a.obj"))).scene().triangles) > 0


def test_lines_that_backslashes_join_without_end_are_refused(read):
    with pytest.raises(DataError, match=r"lines up to \d+, which backslashes join, have more than 1048576 bytes"):
        read(SQUARE + "f 1 2 \\\n" + "3 \\\n" * 400_000)
    mesh = read("mtllib m.mtl\n" + SQUARE + "f 1 2 \\\n3\n", m_mtl="newmtl a\nmap_Kd x\\\n" + "x\\\n" * 40_000)
    assert "'m.mtl' (it has a line of more than 65536 bytes)" in mesh.notes[0]
