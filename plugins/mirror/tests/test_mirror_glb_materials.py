"""Materials of GLB files: pictures, places on them, colours, and what is said about those that cannot be shown."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from omnilab_mirror import Mirror
from omnilab_mirror.scene.meshes.mesh_materials import GREY

FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)  # red, green above blue, yellow


# ------------------------------------------------------------------------------------------------ materials
def transform(**values) -> dict[str, Any]:
    return {"extensions": {"KHR_texture_transform": values}}


@pytest.mark.parametrize(
    ("reference", "color"),
    [
        ({}, (255, 0, 0)),
        ({"texCoord": 1}, (255, 255, 0)),
        (transform(offset=[0.5, 0]), (0, 255, 0)),
        (transform(offset=[0, 0.5]), (0, 0, 255)),
        (transform(scale=[3, 1]), (0, 255, 0)),
        (transform(scale=[1, 3]), (0, 0, 255)),
        (transform(scale=[3, 1], offset=[0, 0.5]), (255, 255, 0)),
        # counter-clockwise as one sees the picture: from right of the corner to above it, which is the lower half again
        (transform(rotation=np.pi / 2), (0, 0, 255)),
        (transform(rotation=-np.pi / 2), (0, 255, 0)),
        (transform(scale=[3, 1], rotation=np.pi / 2), (255, 0, 0)),  # scaled first
        (transform(scale=[1, 3], rotation=np.pi / 2), (255, 255, 0)),
        (transform(texCoord=1), (255, 255, 0)),
        ({"texCoord": 1, **transform(texCoord=0)}, (255, 0, 0)),
        ({"texCoord": 1, **transform(offset=[0.5, 0])}, (0, 0, 255)),
    ],
)
def test_places_on_pictures(read_glb, pictured_glb, shown, reference, color):
    mesh = read_glb(pictured_glb(reference))
    assert shown(mesh) == [color]
    assert mesh.notes == []
    assert "1 materials, 1 textures found, 0 missing" in mesh.content


def test_rotation_is_as_the_three_programs_do_it(read_glb, new_glb):
    # a point at (1, 0), right of the corner, goes up by a turn of 30 degrees counter-clockwise: v, which points down, falls
    glb = new_glb()
    glb.wall(TEXCOORD_0=glb.accessor(np.tile(np.array([[1, 0]], np.float32), (4, 1))))
    glb.add("textures", {"source": glb.image(FOUR)})
    read_uv = read_glb(
        glb.with_material({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **transform(rotation=np.pi / 6)}}})
    )
    assert np.allclose(read_uv.triangles.uv, [np.sqrt(3) / 2, -0.5])


def specular_glossiness(**values) -> dict[str, Any]:
    return {"extensions": {"KHR_materials_pbrSpecularGlossiness": values}}


@pytest.mark.parametrize(
    ("content", "color"),
    [
        (specular_glossiness(diffuseTexture={"index": 0}), (255, 0, 0)),
        (specular_glossiness(diffuseTexture={"index": 0, "texCoord": 1}), (255, 255, 0)),
        (specular_glossiness(diffuseFactor=[0, 0, 1, 1]), (0, 0, 255)),
        (specular_glossiness(diffuseTexture={"index": 0}, diffuseFactor=[0.2140411, 1, 1, 1]), (127, 0, 0)),
    ],
)
def test_specular_glossiness(read_glb, pictured_glb, shown, content, color):
    assert shown(read_glb(pictured_glb({}, **content))) == [color]


@pytest.mark.parametrize(
    ("content", "color", "note"),
    [
        ({}, (255, 255, 255), None),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}, (255, 0, 0), None),
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.2140411, 0, 0, 1]}}, (127, 0, 0), None),  # linear in light
        ({"alphaMode": "BLEND"}, (255, 255, 255), "1 materials are transparent"),
        ({"alphaMode": "OPAQUE"}, (255, 255, 255), None),
        ({"extensions": {"KHR_materials_transmission": {}}}, (255, 255, 255), "1 materials are transparent"),
        ({"emissiveFactor": [0, 1, 0]}, (255, 255, 255), "1 materials glow by themselves"),
        ({"extensions": {"KHR_materials_unlit": {}}}, (255, 255, 255), None),
    ],
)
def test_colours_of_materials(read_glb, new_glb, shown, content, color, note):
    glb = new_glb()
    glb.wall()
    mesh = read_glb(glb.with_material(content))
    assert shown(mesh) == [color]
    assert (note is None and mesh.notes == []) or (note and len(mesh.notes) == 1 and note in mesh.notes[0])


@pytest.mark.parametrize(
    "colors",
    [
        np.array([[255, 0, 55]] * 4, np.uint8),
        np.array([[65535, 0, 14_028, 65535]] * 4, np.uint16),
        np.array([[1, 0, 0.2140411]] * 4, np.float32),
    ],
)
def test_colours_of_vertices(read_glb, new_glb, shown, colors):
    glb = new_glb()
    glb.wall(COLOR_0=glb.accessor(colors, **({"normalized": True} if colors.dtype.kind == "u" else {})))
    assert np.allclose(shown(read_glb(glb)), [(255, 0, 127)], atol=1)
    assert np.allclose(
        shown(read_glb(glb.with_material({"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 1, 1]}}))),
        [(0, 0, 127)],
        atol=1,
    )


def test_what_has_no_material_is_grey(read_glb, new_glb, shown):
    glb = new_glb()
    glb.wall()
    assert shown(read_glb(glb)) == [GREY]


def test_pictures_in_webp_in_a_uri_and_beside_the_file(read_glb, pictured_glb, shown, tmp_path):
    assert shown(read_glb(pictured_glb({}, "WEBP", {"extensions": {"EXT_texture_webp": {"source": 0}}}))) == [
        (255, 0, 0)
    ]
    stream = io.BytesIO()
    Image.fromarray(FOUR).save(stream, "PNG")
    (tmp_path / "my four.png").write_bytes(stream.getvalue())
    for uri in ("my%20four.png", "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()):
        glb = pictured_glb({})
        glb.json["images"] = [{"uri": uri}]
        assert shown(read_glb(glb)) == [(255, 0, 0)]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"images": [{"uri": "gone.png"}]}, "'gone.png' (No such file"),
        ({"images": [{"uri": "../a.png"}]}, "'../a.png' (it lies outside the folder"),
        ({"images": [{"uri": "a%00b.png"}]}, "its name holds a NUL character"),
        ({"images": [{"uri": "data:image/png;base64,????"}]}, "'image 0.png' ("),
        ({"textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]}, "Basis Universal textures, KHR_texture_basisu, which is not read"),
        ({"textures": [{}]}, "it has nothing, which is not read"),
    ],
)  # fmt: skip
def test_pictures_that_cannot_be_had(read_glb, pictured_glb, shown, change, reason):
    glb = pictured_glb({})
    glb.json.update(change)
    mesh = read_glb(glb)
    assert "1 textures or materials are missing, grey stands in" in mesh.notes[0]
    assert reason in mesh.notes[0]
    assert shown(mesh) == [GREY]


def test_a_picture_with_a_fallback_is_read_glb(read_glb, pictured_glb, shown):
    glb = pictured_glb({}, source={"source": 0, "extensions": {"KHR_texture_basisu": {"source": 5}}})
    assert shown(read_glb(glb)) == [(255, 0, 0)]


def test_clamped_pictures_are_said_where_it_matters(read_glb, pictured_glb):
    for offset, count in ((0, 0), (0.9, 2)):
        glb = pictured_glb(transform(offset=[offset, 0]))
        glb.json["textures"][0]["sampler"] = glb.add("samplers", {"wrapS": 33071})
        notes = read_glb(glb).notes
        assert len(notes) == bool(count)
        assert not count or "2 triangles go beyond the edge of a picture that ends" in notes[0]


def test_a_texture_without_places_is_said(read_glb, pictured_glb, shown):
    mesh = read_glb(pictured_glb({"texCoord": 7}))
    assert "2 triangles have a texture but no texture coordinates" in mesh.notes[0]
    assert shown(mesh) == [(255, 255, 255)]


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_places_that_are_no_numbers_are_counted(read_glb, new_glb, tmp_path, bad):
    glb = new_glb()
    glb.wall(TEXCOORD_0=glb.accessor(np.full((4, 2), bad, np.float32)))
    glb.add("textures", {"source": glb.image(FOUR)})
    mesh = read_glb(glb.with_material({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}))
    assert "2 triangles have texture coordinates that are NaN, infinite or above 1e+06" in mesh.notes[0]
    assert len(Mirror(world=str(Path(tmp_path / "a.glb"))).scene().triangles) > 0
