"""Files of meshes: what is read from them, and everything wrong that may be in them."""

from __future__ import annotations

import io
import logging
import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from omnilab.errors import ConfigError, DataError
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.meshes import mesh_file, mesh_materials
from omnilab_mirror.scene.meshes.mesh_file import read_mesh

# ----------------------------------------------------------------------------------------------------------- good input
TRIANGLE = {"vertices": [[0, 0, 0], [2, 0, 0], [0, 3, 1]], "faces": [[0, 1, 2]]}


def test_glb_is_turned_from_y_up_to_z_up_and_others_stay(save):
    y_up = {"vertices": [[0, 0, 0], [2, 0, 0], [0, 1, -3]], "faces": [[0, 1, 2]]}
    expected = np.array(TRIANGLE["vertices"])[None]
    assert np.allclose(read_mesh(Path(save("a.glb", **y_up))).triangles.corners, expected)
    assert np.allclose(read_mesh(Path(save("a.ply", **y_up)), up="y").triangles.corners, expected)
    assert np.allclose(read_mesh(Path(save("a.ply", **TRIANGLE))).triangles.corners, expected)
    assert np.allclose(read_mesh(Path(save("a.obj", **TRIANGLE))).triangles.corners, expected)


def test_the_graph_of_a_glb_places_its_parts(tmp_path):
    scene, shift = trimesh.Scene(), np.eye(4)
    mesh = trimesh.Trimesh(**TRIANGLE)
    for i in range(2):
        shift[:3, 3] = [10.0 * i, 0, 0]
        scene.add_geometry(mesh, node_name=f"n{i}", geom_name="one", transform=shift)
    scene.export(tmp_path / "two.glb")
    triangles = read_mesh(tmp_path / "two.glb").triangles
    assert len(triangles) == 2
    assert np.allclose(np.ptp(triangles.corners[..., 0].min(axis=1)), 10)


def test_colours_of_vertices_faces_and_materials_are_read(save, tmp_path):
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]], np.uint8)
    ply = read_mesh(Path(save("a.ply", **TRIANGLE, vertex_colors=colors))).triangles
    assert np.array_equal(ply.colors[0], colors[:, :3])
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0.2 0\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\no thing\nusemtl red\nf 1 2 3\n")
    obj = read_mesh(tmp_path / "a.obj").triangles
    assert np.array_equal(obj.pictures[obj.picture[0]], [[[255, 51, 0]]])
    assert "thing" in obj.names[obj.name[0]]
    material = PBRMaterial(baseColorFactor=[128, 255, 0, 255])
    glb = read_mesh(
        Path(save("a.glb", **TRIANGLE, visual=TextureVisuals(np.zeros((3, 2)), material=material)))
    ).triangles
    # linear 128 / 255 is 188 of 255 as displayed (IEC 61966-2-1)
    assert np.array_equal(glb.pictures[glb.picture[0]], [[[188, 255, 0]]])
    plain = read_mesh(Path(save("b.ply", **TRIANGLE))).triangles
    assert np.all(plain.colors[0] == mesh_materials.GREY)


# ------------------------------------------------------------------------------------------------ bad input
OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl it\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no triangles; export"),
        ("a.obj", "", "holds no triangles|is no whole OBJ"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n", "holds no triangles"),
        ("a.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "1 triangles, the first in .* NaN or infinite; clean"),
        ("a.obj", "v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n", "NaN or infinite"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "none of its 1 triangles has an area"),
        ("a.obj", "v 0 0 0\nv 9e3 0 0\nv 0 9e3 0\nf 1 2 3\n", "9000 x 9000 m and 0 m high, a world may have 5000 m; .* scale: 0.001"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "is no whole OBJ file|no vertex"),
        ("a.glb", "glTF and then nothing", "is no whole GLB file .*; save it again"),
        ("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nend_header\n", "is no whole PLY file|holds no triangles"),
        ("a.stl", "solid", "ending '.stl'; meshes are read from .obj, .glb and .ply"),
    ],
)  # fmt: skip
def test_bad_mesh_files_are_reported_in_a_sentence(write, name, content, sentence):
    with pytest.raises(DataError, match=sentence):
        load_world(write(content, name))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"chair\.glb' cannot be read \(there is no such file\); give"):
        load_world(str(tmp_path / "chair.glb"))


@pytest.mark.parametrize(
    ("texture", "reason"),
    [
        ("missing.png", "No such file"),
        ("../outside.png", "outside the folder"),
        ("broken.png", "cannot identify"),
        ("cut.png", "[Tt]runcated|broken"),
        ("pipe.png", "a pipe or a device, no file"),
        ("folder.png", "is a folder"),
        ("program.png", "cannot identify"),
    ],
)
def test_grey_stands_in_for_textures_that_cannot_be_had(write, tmp_path, caplog, texture, reason):
    folder = tmp_path / "mesh"
    folder.mkdir()
    stream = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)).save(stream, "PNG")
    (tmp_path / "outside.png").write_bytes(stream.getvalue())
    (folder / "cut.png").write_bytes(stream.getvalue()[:4000])
    (folder / "broken.png").write_bytes(b"this is no picture")
    (folder / "program.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n")
    (folder / "folder.png").mkdir()
    os.mkfifo(folder / "pipe.png")
    write(f"newmtl it\nKd 1 1 1\nmap_Kd {texture}\n", "mesh/a.mtl")
    with caplog.at_level(logging.WARNING, logger="omnilab"):
        world = load_world(write(OBJ, "mesh/a.obj"))
    assert len(world.notes) == 1
    assert re.search(
        rf"1 textures or materials are missing, grey stands in: '{texture}' \(.*({reason})", world.notes[0]
    )
    assert world.notes[0] in caplog.text
    mesh = world.meshes[0]
    assert np.all(mesh.pictures[mesh.picture[0]] == mesh_materials.GREY)


def test_a_picture_inside_a_glb_that_cannot_be_opened_is_reported(tmp_path):
    image = Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8))
    image.format = "PNG"
    visual = TextureVisuals(np.zeros((3, 2)), material=PBRMaterial(baseColorTexture=image))
    data = trimesh.Trimesh(**TRIANGLE, visual=visual, process=False).export(file_type="glb")
    (tmp_path / "good.glb").write_bytes(data)
    (tmp_path / "bad.glb").write_bytes(data.replace(b"\x89PNG", b"\x00PNG"))
    assert read_mesh(tmp_path / "good.glb").notes == []
    bad = read_mesh(tmp_path / "bad.glb")
    assert "grey stands in: 'image 0.png' (cannot identify" in bad.notes[0]
    assert np.all(bad.triangles.pictures[bad.triangles.picture[0]] == mesh_materials.GREY)
    assert len(bad.triangles) == 1


def test_triangles_without_an_area_are_left_out_and_counted(write):
    world = load_world(write("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 2\nf 1 2 4\n", "a.obj"))
    assert world.notes == ["2 triangles without an area were left out"]
    assert len(world.meshes[0]) == 1


def test_what_is_too_large_is_refused(write, tmp_path, monkeypatch):
    path = write(OBJ.replace("f 1/1 2/2 3/3\n", "f 1/1 2/2 3/3\n" * 3), "a.obj")
    Image.new("RGB", (64, 32)).save(tmp_path / "t.png")
    write("newmtl it\nmap_Kd t.png\n", "a.mtl")
    for module, limit, value, sentence in (
        (mesh_file, "MAX_TRIANGLES", 2, "has 3 triangles, 2 may be read; decimate"),
        (mesh_file, "MAX_BYTES", {".obj": 10}, "bytes, more than 10.; decimate"),
        (mesh_materials, "MAX_PIXELS", 100, "'t.png' has 64 x 32 pixels, 100 may be read; make it smaller"),
        (mesh_materials, "MAX_TEXELS", 100, "textures of more than 100 pixels; make them smaller"),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(module, limit, value)
            with pytest.raises(DataError, match=sentence):
                read_mesh(Path(path))
    assert len(read_mesh(Path(path)).triangles) == 3


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            "file: ../a.obj, at: [0, 0]",
            r"object 1 has file='\.\./a\.obj'; expected a file in the folder of the world file",
        ),
        ("file: b.obj, at: [0, 0]", r"object 1 has a mesh that cannot be used: .*b\.obj cannot be read"),
        ("file: b.fbx, at: [0, 0]", "has the ending '.fbx'"),
        ("file: a.obj, at: [0, 0], up: x", "unknown up 'x'"),
        ("file: a.obj, at: [0, 0], scale: 0", "scale=0; expected a finite number from"),
    ],
)
def test_bad_objects_of_kind_mesh(write, line, sentence):
    write(OBJ, "a.obj")
    with pytest.raises(DataError, match=sentence):
        load_world(write(f"map_m: [1, 1]\nobjects:\n  - {{kind: mesh, {line}}}\n"))


def test_the_digest_is_of_mesh_material_and_textures_and_files_that_change_are_read_again(write, tmp_path):
    def picture(value):
        Image.new("RGB", (4, 4 + value), (value, 0, 0)).save(tmp_path / "t.png")

    picture(10)
    write("newmtl it\nmap_Kd t.png\n", "a.mtl")
    write(OBJ, "a.obj")
    world = write("map_m: [1, 1]\nobjects:\n  - {kind: mesh, file: a.obj, at: [0, 0]}\n")
    seen = [load_world(world)]
    picture(20)
    seen.append(load_world(world))
    write("newmtl it\nKd 1 0 0\n", "a.mtl")
    seen.append(load_world(world))
    write(OBJ + "# changed\n", "a.obj")
    seen.append(load_world(world))
    assert len({w.digest for w in seen}) == 4
    assert [int(w.meshes[0].pictures[0][0, 0, 0]) for w in seen] == [10, 20, 255, 255]
    assert load_world(world) is seen[-1]
