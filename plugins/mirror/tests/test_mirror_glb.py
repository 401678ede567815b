"""GLB files as the glTF 2.0 specification allows them give the areas and places that were written."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnilab.errors import DataError
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.meshes import glb as glb_module
from omnilab_mirror.scene.meshes import mesh_file
from omnilab_mirror.scene.meshes.mesh_file import read_mesh

POINTS = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]], np.float32)


# ------------------------------------------------------------------------------------------------ triangles
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_triangles_written_in_any_layout_are_the_same(new_glb, area, tmp_path, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    glb, count = new_glb(), int(rng.integers(3, 40))
    points = rng.normal(size=(count, 3)).astype(np.float32)
    mode = data.draw(st.sampled_from([4, 5, 6]))
    kind = data.draw(st.sampled_from([None, np.uint8, np.uint16, np.uint32]))
    index = np.arange(count) if kind is None else rng.integers(0, count, int(rng.integers(1, 9)) * 3)
    if mode == 4:
        faces = index[: len(index) // 3 * 3].reshape(-1, 3)
    elif mode == 5:
        faces = np.array([index[i : i + 3] for i in range(len(index) - 2)])
    else:
        faces = np.array([[index[0], index[i + 1], index[i + 2]] for i in range(len(index) - 2)])
    layout, more = data.draw(st.sampled_from(["tight", "interleaved", "quantised", "sparse"])), {}
    if layout == "tight":
        position = glb.accessor(points)
    elif layout == "interleaved":
        rows = np.hstack([np.full((count, 2), 7, np.float32), points, np.full((count, 1), 9, np.float32)])
        view = glb.view(rows.tobytes(), byteStride=24)
        position = glb.add(
            "accessors", {"bufferView": view, "byteOffset": 8, "componentType": 5126, "count": count, "type": "VEC3"}
        )
    elif layout == "quantised":
        steps = np.clip(np.rint(points / 4 * 32767), -32767, 32767).astype(np.int16)
        rows = np.hstack([steps, np.zeros((count, 1), np.int16)])
        view = glb.view(rows.tobytes(), byteStride=8)
        item = {"bufferView": view, "componentType": 5122, "count": count, "type": "VEC3", "normalized": True}
        position, points = glb.add("accessors", item), steps / 32767
        glb.json["extensionsRequired"], more = ["KHR_mesh_quantization"], {"scale": [4, 4, 4]}
        points = points * 4
    else:
        kept = np.sort(rng.choice(count, int(rng.integers(1, count)), replace=False))
        base = rng.normal(size=(count, 3)).astype(np.float32)
        base[np.setdiff1d(np.arange(count), kept)] = points[np.setdiff1d(np.arange(count), kept)]
        where = {"bufferView": glb.view(kept.astype(np.uint16).tobytes()), "componentType": 5123}
        sparse = {"count": len(kept), "indices": where, "values": {"bufferView": glb.view(points[kept].tobytes())}}
        position = glb.accessor(base, sparse=sparse)
    part = {"attributes": {"POSITION": position}, "mode": mode}
    if kind is not None:
        part["indices"] = glb.accessor(index.astype(kind))
    glb.add("nodes", {"mesh": glb.add("meshes", {"primitives": [part]}), **more})
    corners = points[faces].astype(float)
    total = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    (tmp_path / "a.glb").write_bytes(glb.bytes())
    if total < 1e-9:
        return
    mesh = read_mesh(tmp_path / "a.glb", "z")
    assert area(mesh) == pytest.approx(total, rel=1e-4, abs=1e-5)


def test_strips_and_fans_face_one_way(read_glb, new_glb):
    for mode, index in ((4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])):
        glb = new_glb()
        part = glb.wall()
        part["mode"], part["indices"] = mode, glb.accessor(np.array(index, np.uint16))
        normals = read_glb(glb).triangles.normals
        assert np.allclose(normals, [[0, 0, 12]] * 2)


@pytest.mark.parametrize(
    ("node", "bounds"),
    [
        ({}, [[0, 0, 0], [4, 3, 0]]),
        ({"translation": [1, 2, 3]}, [[1, 2, 3], [5, 5, 3]]),
        ({"scale": [2, 1, 1], "translation": [1, 0, 0]}, [[1, 0, 0], [9, 3, 0]]),
        ({"rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]}, [[-3, 0, 0], [0, 4, 0]]),  # a quarter turn around z
        ({"rotation": [0, 0, 2, 2], "scale": [2, 1, 1]}, [[-3, 0, 0], [0, 8, 0]]),  # not of unit length
        ({"matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]}, [[2, 6, 7], [5, 10, 7]]),
    ],
)
def test_nodes_place_their_meshes(read_glb, new_glb, node, bounds):
    glb = new_glb()
    glb.wall()
    glb.json["nodes"][0].update(node)
    assert np.allclose(read_glb(glb).triangles.bounds, bounds, atol=1e-6)
    parent = glb.add("nodes", {"children": [0], "translation": [10, 0, 0], "scale": [2, 2, 2]})
    glb.json["scenes"] = [{"nodes": [parent]}]
    assert np.allclose(read_glb(glb).triangles.bounds, 2 * np.array(bounds) + [10, 0, 0], atol=1e-5)


def test_mirrored_meshes_keep_their_front(read_glb, new_glb):
    glb = new_glb()
    glb.wall()
    glb.json["nodes"] = [{"mesh": 0, "scale": [-1, 1, 1]}, {"mesh": 0}]
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    mesh = read_glb(glb).triangles
    assert np.allclose(mesh.normals, [[0, 0, 12]] * 4)  # all still face +z
    assert mesh.bounds[:, 0].tolist() == [-4, 4]


@pytest.mark.parametrize(("up", "asked"), [("y", True), ("z", False)])
def test_a_room_that_is_z_up_against_the_standard_is_asked_about(new_glb, tmp_path, up, asked):
    glb = new_glb()
    corners = np.array([[x, y, z] for z in (0, 2.5) for x, y in ((0, 0), (6, 0), (6, 5), (0, 5))], np.float32)
    faces = [
        [0, 1, 2],
        [0, 2, 3],
        [4, 6, 5],
        [4, 7, 6],
        [0, 4, 5],
        [0, 5, 1],
        [1, 5, 6],
        [1, 6, 2],
        [2, 6, 7],
        [2, 7, 3],
    ]
    part = {
        "attributes": {"POSITION": glb.accessor(corners)},
        "indices": glb.accessor(np.array(faces, np.uint16).reshape(-1)),
    }
    glb.add("nodes", {"mesh": glb.add("meshes", {"primitives": [part]})})
    (tmp_path / "room.glb").write_bytes(glb.bytes())
    notes = load_world(str(tmp_path / "room.glb"), up=up).notes
    assert bool(notes) == asked
    assert not asked or "set sensor.up=z" in notes[0]


def test_a_mesh_that_many_nodes_show_is_read_once(read_glb, new_glb):
    glb = new_glb()
    glb.wall()
    glb.json["nodes"] = [{"mesh": 0, "translation": [5.0 * i, 0, 0]} for i in range(5_000)]
    glb.json["scenes"] = [{"nodes": list(range(5_000))}]
    mesh = read_glb(glb)
    assert len(mesh.triangles) == 10_000
    assert mesh.triangles.bounds[1, 0] == pytest.approx(5.0 * 4_999 + 4)
    assert len(set(mesh.triangles.name.tolist())) == 5_000  # each is an object of its own


def test_too_many_nodes_are_refused_before_they_are_placed(read_glb, new_glb, monkeypatch):
    monkeypatch.setattr(glb_module, "MAX_NODES", 10)
    glb = new_glb()
    glb.json["nodes"] = [{}] * 11
    with pytest.raises(DataError, match="it has 11 nodes, up to 10 are read"):
        read_glb(glb)


def test_instances_beyond_the_limit_are_refused_before_they_are_made(read_glb, new_glb, monkeypatch):
    monkeypatch.setattr(mesh_file, "MAX_TRIANGLES", 1000)
    glb = new_glb()
    glb.wall()
    glb.json["nodes"] = [{"mesh": 0}] * 600
    glb.json["scenes"] = [{"nodes": list(range(600))}]
    with pytest.raises(DataError, match=r"has 1200 triangles or more, 1000 may be read"):
        read_glb(glb)


# ------------------------------------------------------------------------------------------------ extensions
@pytest.mark.parametrize(
    ("extension", "words"),
    [
        ("KHR_draco_mesh_compression", "Draco compression"),
        ("EXT_meshopt_compression", "meshopt compression"),
        ("KHR_texture_basisu", "Basis Universal textures"),
        ("EXT_mesh_gpu_instancing", "instances of a mesh"),
        ("VENDOR_hidden_shapes", "VENDOR_hidden_shapes"),
    ],
)
def test_required_extensions_that_are_not_read_are_refused_by_name(read_glb, new_glb, area, extension, words):
    glb = new_glb()
    glb.wall()
    glb.json["extensionsUsed"] = glb.json["extensionsRequired"] = [extension]
    with pytest.raises(
        DataError, match=rf"needs the glTF extension {extension}.*; export the mesh without it"
    ) as error:
        read_glb(glb)
    assert words in str(error.value)
    del glb.json["extensionsRequired"]
    assert area(read_glb(glb)) == 12  # what is only used has a fallback


@pytest.mark.parametrize(
    "extension", ["KHR_texture_transform", "KHR_materials_unlit", "KHR_lights_punctual", "KHR_mesh_quantization"]
)
def test_required_extensions_that_are_read_or_change_no_shape(read_glb, new_glb, area, extension):
    glb = new_glb()
    glb.wall()
    glb.json["extensionsRequired"] = [extension]
    assert area(read_glb(glb)) == 12


def test_compressed_parts_without_a_fallback_are_refused_though_nothing_is_required(read_glb, new_glb, area):
    glb = new_glb()
    part = glb.wall()
    part["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
    assert area(read_glb(glb)) == 12  # the fallback
    for accessor in glb.json["accessors"]:
        del accessor["bufferView"]
    with pytest.raises(DataError, match="needs the glTF extension KHR_draco_mesh_compression"):
        read_glb(glb)
    glb = new_glb()
    part = glb.wall()
    glb.json["buffers"] = [
        {"byteLength": len(glb.data)},
        {"byteLength": 48, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
    ]
    glb.json["bufferViews"][part["attributes"]["POSITION"]].update(
        buffer=1, byteOffset=0, extensions={"EXT_meshopt_compression": {}}
    )
    with pytest.raises(DataError, match="needs the glTF extension EXT_meshopt_compression"):
        read_glb(glb)


def test_instances_that_are_not_required_are_said(read_glb, new_glb):
    glb = new_glb()
    glb.wall()
    glb.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {}}}
    assert "1 instances of a mesh" in read_glb(glb).notes[0]


# ------------------------------------------------------------------------------------------------ what is wrong, and said
def broken(glb, **change):
    """A wall some of whose file is otherwise."""
    glb.wall()
    for key, value in change.items():
        kind, _, field = key.partition("__")
        glb.json[kind] = value if not field else [{**item, field: value} for item in glb.json[kind]]
    return glb


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"asset": {"version": "1.0"}}, r"of version 1\.0 of glTF"),
        ({"asset": 3}, "'3' where an object should be"),
        ({"scene": 4}, "refers to scenes 4, and has 1"),
        ({"scenes": [{"nodes": [7]}]}, "refers to nodes 7, and has 1"),
        ({"scenes": [{"nodes": [-1]}]}, "refers to nodes -1"),
        ({"scenes": [{"nodes": [0, 0]}]}, "nodes 0 is below itself or below two others"),
        ({"nodes": [{"children": [1]}, {"children": [0], "mesh": 0}]}, "nodes 0 is below itself"),
        ({"nodes": [{"children": [0], "mesh": 0}]}, "nodes 0 is below itself"),
        ({"nodes": [{"mesh": 0, "rotation": [0, 0, 0, 0]}]}, "a rotation of 0 0 0 0"),
        ({"nodes": [{"mesh": 0, "matrix": [1, 2]}]}, "where 16 numbers should be"),
        ({"nodes": [{"mesh": 0, "translation": [1, 2, "x"]}]}, "where 3 numbers should be"),
        ({"nodes": [{"mesh": 0, "translation": [1, 2, float("nan")]}]}, "where 3 finite numbers should be"),
        ({"nodes": [{"mesh": 0.5}]}, r"refers to meshes 0\.5"),
        ({"nodes": "x"}, "where a list should be|not that of glTF"),
        ({"meshes": [{"primitives": [{"attributes": {}}]}]}, "has no positions"),
        ({"meshes": [{"primitives": 3}]}, r"not that of glTF 2\.0"),
        ({"accessors__componentType": 5124}, r"a type that is not in glTF 2\.0"),
        ({"accessors__count": 10**9}, "rows, up to|there are|ends beyond"),
        ({"accessors__count": -1}, "'-1' where a whole number from 0 should be"),
        ({"accessors__count": 1000}, "ends beyond its buffer view"),
        ({"accessors__byteOffset": 44}, "ends beyond its buffer view"),
        ({"bufferViews__byteLength": 10**6}, "ends beyond its buffer"),
        ({"bufferViews__byteStride": 1}, "ends beyond its buffer view"),
        ({"bufferViews__buffer": 3}, "refers to buffers 3"),
        ({"buffers": [{"byteLength": 9, "uri": "gone.bin"}]}, "its file 'gone.bin' cannot be had: No such file"),
        ({"accessors__sparse": {"count": 10**9, "indices": {}, "values": {}}}, "sparse|type that is not"),
    ],
)
def test_what_is_not_as_gltf_has_it(read_glb, new_glb, change, sentence):
    with pytest.raises(DataError, match=rf"is no whole GLB file \(.*({sentence}).*; save it again") as error:
        read_glb(broken(new_glb(), **change))
    assert "\n" not in str(error.value)


def test_a_triangle_beyond_the_vertices(read_glb, new_glb):
    glb = new_glb()
    part = glb.wall()
    part["indices"] = glb.accessor(np.array([0, 1, 4], np.uint16))
    with pytest.raises(DataError, match="a triangle has the vertex 4, and there are 4, from 0"):
        read_glb(glb)


def test_sparse_values_beyond_the_rows(read_glb, new_glb):
    glb = new_glb()
    part = glb.wall()
    where = {"bufferView": glb.view(np.array([9], np.uint16).tobytes()), "componentType": 5123}
    sparse = {"count": 1, "indices": where, "values": {"bufferView": glb.view(POINTS[:1].tobytes())}}
    part["attributes"]["POSITION"] = glb.accessor(POINTS, sparse=sparse)
    with pytest.raises(DataError, match="a sparse value for row 9 of 4"):
        read_glb(glb)


def test_zeros_without_data_are_bounded(read_glb, new_glb):
    glb = new_glb()
    part = glb.wall()
    part["attributes"]["POSITION"] = glb.add("accessors", {"componentType": 5126, "count": 10**12, "type": "VEC3"})
    with pytest.raises(DataError, match=r"has 1000000000000 rows, up to"):
        read_glb(glb)


def test_files_that_are_cut_or_changed_anywhere_end_in_a_sentence(read_glb, pictured_glb):
    glb = pictured_glb({"texCoord": 1})
    data = glb.bytes()
    for length in range(0, len(data), 9):
        with pytest.raises(DataError):
            read_glb(data[:length])
    rng = np.random.default_rng(0)
    for _ in range(100):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] = int(rng.integers(256))
        try:
            read_glb(bytes(damaged))
        except DataError as error:
            assert "\n" not in str(error)  # noqa: PT017


def test_json_that_is_deep_or_none(read_glb):
    for text in (b"[" * 100_000, b"[]", b"{", b"3", b'{"asset": {"version": "2.0"}}'):
        padded = text + b" " * (-len(text) % 4)
        with pytest.raises(DataError):
            read_glb(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(padded), len(padded), b"JSON") + padded)


@pytest.mark.parametrize(
    ("change", "note"),
    [
        ({"scenes": [{"nodes": [0]}, {"nodes": []}]}, "1 further scenes are not shown"),
        ({"nodes": [{"mesh": 0, "skin": 0}]}, "1 meshes are bent by bones"),
    ],
)
def test_what_is_not_shown_is_counted(read_glb, new_glb, change, note):
    assert note in read_glb(broken(new_glb(), **change)).notes[0]


def test_points_and_lines_are_counted(read_glb, new_glb):
    glb = new_glb()
    part = glb.wall()
    glb.json["meshes"][0]["primitives"].append({**part, "mode": 1})
    assert read_glb(glb).notes == ["1 sets of points or lines were left out"]
