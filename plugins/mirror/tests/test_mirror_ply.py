"""PLY files as text and as bytes of either order, of triangles and polygons, give the areas and colours that were written."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from omnilab.errors import DataError
from omnilab_mirror.scene.meshes.mesh_file import MeshFile, read_mesh
from omnilab_mirror.scene.meshes.mesh_materials import GREY

CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
POINTS = [(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0), (4, 0, 2.5), (4, 3, 2.5)]
XYZ = [("x", "float"), ("y", "float"), ("z", "float")]
INDEX = ("vertex_indices", "uchar", "int")


def ply(form: str, elements, comments=(), end: str = "\n") -> bytes:
    """A file of elements (name, properties, rows); a property is (name, type) or, a list, (name, type of length, type)."""
    lines = ["ply", f"format {form} 1.0", *(f"comment {text}" for text in comments)]
    body = b""
    for name, properties, rows in elements:
        lines.append(f"element {name} {len(rows)}")
        for title, *types in properties:
            lines.append(f"property {'list ' if len(types) == 2 else ''}{' '.join(types)} {title}")
        for row in rows:
            words = []
            for (_, *types), value in zip(properties, row, strict=True):
                values = list(value) if len(types) == 2 else [value]
                kinds = ([types[0]] if len(types) == 2 else []) + [types[-1]] * len(values)
                values = [len(values), *values] if len(types) == 2 else values
                if form == "ascii":
                    words += [
                        repr(float(v)) if kind in {"float", "double"} else str(v)
                        for v, kind in zip(values, kinds, strict=True)
                    ]
                else:
                    body += b"".join(
                        struct.pack(ORDERS[form] + CODES[kind], v) for v, kind in zip(values, kinds, strict=True)
                    )
            if form == "ascii":
                body += " ".join(words).encode() + end.encode()
    return end.join([*lines, "end_header", ""]).encode("latin-1") + body


@pytest.fixture
def read(tmp_path):
    def read(data: bytes) -> MeshFile:
        (tmp_path / "a.ply").write_bytes(data)
        return read_mesh(tmp_path / "a.ply")

    return read


def room(form="binary_little_endian", vertex=(), face=(), values=(), face_values=(), faces=None, **options) -> bytes:
    """A floor of four corners and a wall of four, with further properties of vertices and faces."""
    faces = [[0, 1, 2, 3], [1, 4, 5, 2]] if faces is None else faces
    vertices = [(*point, *values) for point in POINTS]
    rows = [(indices, *(face_values[i] if face_values else ())) for i, indices in enumerate(faces)]
    return ply(form, [("vertex", [*XYZ, *vertex], vertices), ("face", [INDEX, *face], rows)], **options)


# ------------------------------------------------------------------------------------------------ dialects
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_polygons_written_in_any_dialect_are_the_same(area, shown, tmp_path, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    form, number = data.draw(st.sampled_from(list(ORDERS))), data.draw(st.sampled_from(["float", "double"]))
    length, index = (
        data.draw(st.sampled_from(["uchar", "ushort", "int"])),
        data.draw(st.sampled_from(["int", "uint", "ushort"])),
    )
    before, between, colored = (data.draw(st.booleans()) for _ in range(3))
    alike = data.draw(st.sampled_from([None, 3, 4, 6]))
    vertices, faces, total = [], [], 0.0
    for k in range(data.draw(st.integers(1, 6))):
        n = alike or int(rng.integers(3, 9))
        angle, radius = np.arange(n) * 2 * np.pi / n, rng.uniform(0.5, 1.5, n)
        shape = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, float(k))])
        total += abs(np.cross(shape, np.roll(shape, -1, 0))[:, 2].sum()) / 2
        faces.append(list(range(len(vertices), len(vertices) + n)))
        vertices += shape.tolist()
    properties = [("x", number), ("y", number), *([("quality", "short")] if between else []), ("z", number)]
    rows = [[x, y, *([7] if between else []), z] for x, y, z in vertices]
    color = [("red", "uchar"), ("green", "uchar"), ("blue", "uchar")] if colored else []
    body = [("flags", "uchar"), ("vertex_index", length, index), ("extra", "uchar", "float"), *color]
    picked = rng.integers(0, 255, (len(faces), 3)).tolist()
    face_rows = [[1, face, [0.5] * (i % 3), *(picked[i] if colored else [])] for i, face in enumerate(faces)]
    elements = [("vertex", properties, rows), ("face", body, face_rows)]
    if before:
        elements.insert(0, ("camera", [("focal", "double"), ("names", "int", "uchar")], [[1.5, [1, 2, 3]], [2.5, []]]))
    text = ply(form, elements, comments=["caf\xe9"], end=data.draw(st.sampled_from(["\n", "\r\n"])))
    (tmp_path / "a.ply").write_bytes(text)
    mesh = read_mesh(tmp_path / "a.ply")
    assert area(mesh) == pytest.approx(total, rel=1e-5)
    assert np.allclose(mesh.triangles.bounds, [np.min(vertices, axis=0), np.max(vertices, axis=0)], atol=1e-5)
    assert mesh.notes == []
    assert shown(mesh) == (sorted({tuple(c) for c in picked}) if colored else [GREY])


@pytest.mark.parametrize("form", list(ORDERS))
@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        ([[0, 1, 2, 3], [1, 4, 5]], 15.75),  # a quad and a triangle
        ([[0, 1, 2], [0, 2, 3], [1, 4, 5, 2]], 19.5),
        ([[0, 1, 2, 3], [1, 4, 5, 2]], 19.5),
        ([[0, 1, 2], [0, 2, 3]], 12),
    ],
)
def test_mixed_polygons(area, read, form, faces, expected):
    mesh = read(room(form, faces=faces))
    assert area(mesh) == pytest.approx(expected)
    assert mesh.notes == []


def test_strips_of_triangles(area, read):
    data = ply("binary_big_endian", [("vertex", XYZ, POINTS), ("tristrips", [("vertex_indices", "int", "int")], [([0, 1, 3, 2, -1, 1, 4, 2, 5],)])])  # fmt: skip
    mesh = read(data)
    assert len(mesh.triangles) == 4
    assert area(mesh) == pytest.approx(19.5)
    assert np.all(mesh.triangles.normals[:2, 2] > 0)  # both halves of the floor face up


# ------------------------------------------------------------------------------------------------ colours
@pytest.mark.parametrize("form", list(ORDERS))
@pytest.mark.parametrize(
    "names",
    [
        ("red", "green", "blue"),
        ("diffuse_red", "diffuse_green", "diffuse_blue"),
        ("r", "g", "b"),
        ("Red", "Green", "Blue"),
    ],
)
@pytest.mark.parametrize(
    ("kind", "values", "noted"),
    [
        ("uchar", (255, 0, 51), 0),
        ("ushort", (65535, 0, 13107), 0),
        ("int", (255, 0, 51), 0),
        ("float", (1.0, 0.0, 0.2), 0),
        ("double", (1.0, 0.0, 0.2), 0),
        ("float", (255.0, 0.0, 51.0), 1),
    ],
)
def test_colours_by_any_name_and_type(shown, read, form, names, kind, values, noted):
    properties = [(name, kind) for name in names]
    mesh = read(room(form, vertex=properties, values=values))
    assert shown(mesh) == [(255, 0, 51)]
    assert len(mesh.notes) == noted
    mesh = read(room(form, face=properties, face_values=[values, values[::-1]]))
    assert shown(mesh) == [(51, 0, 255), (255, 0, 51)]
    assert len(mesh.notes) == noted


def test_colours_of_quads_end_in_a_picture(read, tmp_path):
    from omnilab_mirror import Mirror

    read(room(face=[("red", "uchar"), ("green", "uchar"), ("blue", "uchar")], face_values=[(255, 0, 0), (0, 255, 0)]))
    assert set(map(tuple, Mirror(world=str(Path(tmp_path / "a.ply"))).scene().colors.tolist())) >= {
        (255, 0, 0),
        (0, 255, 0),
    }


@pytest.mark.parametrize(
    ("vertex", "values", "note"),
    [
        ([("intensity", "float")], (0.5,), "1 properties may be colours, but are not called red, green and blue"),
        ([("red", "uchar"), ("green", "uchar")], (9, 9), "2 properties may be colours"),
        ([("nx", "float"), ("quality", "float")], (0, 0), None),
        (
            [("red", "uchar"), ("green", "uchar"), ("blue", "uchar")],
            (1, 0, 1),
            "1 sets of colours are whole numbers of 0 and 1",
        ),
        ([("red", "float"), ("green", "float"), ("blue", "float")], (-1, 0.5, 1), "6 colours below 0"),
        ([("red", "float"), ("green", "float"), ("blue", "float")], (np.nan, 0.5, 1), "6 colours below 0"),
    ],
)
def test_what_may_be_colours_is_said(read, vertex, values, note):
    notes = read(room(vertex=vertex, values=values)).notes
    assert (note is None and notes == []) or (note and len(notes) == 1 and note in notes[0])


def test_colours_of_faces_beside_those_of_vertices_are_said(shown, read):
    color = [("red", "uchar"), ("green", "uchar"), ("blue", "uchar")]
    mesh = read(room(vertex=color, values=(9, 8, 7), face=color, face_values=[(255, 0, 0), (0, 255, 0)]))
    assert shown(mesh) == [(9, 8, 7)]
    assert "2 colours of faces are not shown" in mesh.notes[0]


@pytest.mark.parametrize("form", list(ORDERS))
def test_pictures_as_meshlab_writes_them(shown, read, tmp_path, form):
    Image.fromarray(np.kron(np.array([[[255, 0, 0]], [[0, 0, 255]]], np.uint8), np.ones((4, 8, 1), np.uint8))).save(
        tmp_path / "my t.png"
    )
    Image.new("RGB", (2, 2), (0, 255, 0)).save(tmp_path / "u.png")
    lower = [0.1, 0.1, 0.9, 0.1, 0.9, 0.4, 0.1, 0.4]  # v goes up: blue
    mesh = read(
        room(
            form,
            face=[("texcoord", "uchar", "float")],
            face_values=[(lower,), (lower,)],
            comments=["TextureFile my t.png"],
        )
    )
    assert shown(mesh) == [(0, 0, 255)]
    assert "1 textures found" in mesh.content
    both = read(room(form, face=[("texcoord", "uchar", "float"), ("texnumber", "int")], face_values=[(lower, 0), (lower, 1)],
                     comments=["TextureFile my t.png", "TextureFile u.png"]))  # fmt: skip
    assert shown(both) == [(0, 0, 255), (0, 255, 0)]
    vertices = read(
        room(form, vertex=[("s", "float"), ("t", "float")], values=(0.5, 0.9), comments=["TextureFile my t.png"])
    )
    assert shown(vertices) == [(255, 0, 0)]
    assert "textures are not shown" in read(room(form, comments=["TextureFile u.png"])).notes[0]
    assert (
        "'gone.png' (No such file"
        in read(
            room(form, vertex=[("s", "float"), ("t", "float")], values=(0, 0), comments=["TextureFile gone.png"])
        ).notes[0]
    )


# ------------------------------------------------------------------------------------------------ what is wrong, and said
def header(*lines: str) -> bytes:
    return "\n".join(["ply", *lines, "end_header", ""]).encode()


VERTEX = ["element vertex 3", "property float x", "property float y", "property float z"]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"plyx\n", "does not begin with 'ply'"),
        (b"ply\nformat ascii 1.0\n", "no 'end_header'"),
        (header("element vertex 0"), "names no format"),
        (header("format ascii 2.0"), "its header has the line 'format ascii 2.0'"),
        (header("format ascii 1.0", "element vertex -3"), "its header has the line 'element vertex -3'"),
        (header("format ascii 1.0", "property float x"), "its header has the line 'property float x'"),
        (header("format ascii 1.0", "element vertex 1", "property half x"), "its header has the line 'property half x'"),
        (header("format ascii 1.0", "element f 1", "property list float int x"), "its header has the line"),
        (header("format ascii 1.0", *VERTEX, "property float x"), "'vertex' has a property twice"),
        (header("format ascii 1.0", *VERTEX, *VERTEX), "an element twice"),
        (header("format binary_little_endian 1.0", "element vertex 30000000", *VERTEX[1:]), "ends within the 30000000 rows"),
        (header("format ascii 1.0", "element vertex 999999999", *VERTEX[1:]), "announces 999999999 rows"),
        (header("format ascii 1.0", *VERTEX) + b"0 0 0 1 0 0 0 1", "ends within the 3 rows"),
        (header("format ascii 1.0", *VERTEX) + b"0 0 0 1 0 0 0 1 0 7", "has 10 numbers, and its header announces 9"),
        (header("format ascii 1.0", *VERTEX) + b"0 0 0 1 0 0 0 1 zero", "has 'zero' where a number should be"),
        (header("format ascii 1.0", *VERTEX) + b"0 0 0 1 0 0 0 1 0,5", "has '0,5' where a number should be"),
    ],
)  # fmt: skip
def test_what_is_no_ply_file(read, data, sentence):
    with pytest.raises(DataError, match=f"is no whole PLY file.*{sentence}.*save it again") as error:
        read(data)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("form", list(ORDERS))
@pytest.mark.parametrize(("faces", "vertex"), [([[0, 1, 6]], 6), ([[0, 1, 2, 3], [0, -1, 2]], -1)])
def test_vertices_that_are_not_there(read, form, faces, vertex):
    with pytest.raises(DataError, match=f"a face has the vertex {vertex}, and there are 6, from 0"):
        read(room(form, faces=faces))


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian"])
def test_files_that_are_cut_anywhere_end_in_a_sentence(read, form):
    for faces in ([[0, 1, 2, 3], [1, 4, 5, 2]], [[0, 1, 2, 3], [1, 4, 5]]):
        data = room(form, faces=faces)
        for length in range(0, len(data), 5):
            with pytest.raises(DataError, match=r"is no whole PLY file|holds no triangles"):
                read(data[:length])


def test_the_other_order_of_bytes_is_an_error(read):
    data = room("binary_little_endian", faces=[[0, 1, 2], [0, 2, 3]])
    with pytest.raises(DataError):
        read(data.replace(b"little", b"big"))


def test_whole_numbers_that_a_type_cannot_hold(read):
    data = ply("ascii", [("vertex", XYZ, POINTS), ("face", [INDEX], [([0, 1, 2],)])])
    with pytest.raises(DataError, match=r"property 'vertex_indices' has 1\.5, which its type cannot hold"):
        read(data.replace(b"3 0 1 2", b"3 0 1.5 2"))
    with pytest.raises(DataError, match="ends within the 1 rows"):
        read(data.replace(b"3 0 1 2", b"-3 0 1 2"))


def test_clouds_of_points_are_named(read):
    with pytest.raises(DataError, match="holds no triangles, but 6 points; make a mesh of them"):
        read(ply("ascii", [("vertex", XYZ, POINTS)]))


def test_faces_of_two_corners_are_counted(read):
    assert read(room(faces=[[0, 1, 2, 3], [0, 1], []])).notes == ["2 faces of fewer than three corners were left out"]
