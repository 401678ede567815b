"""World files in other encodings, and files that they name with accents."""

from __future__ import annotations

import unicodedata

import numpy as np
import pytest
from PIL import Image

from omnilab.errors import DataError
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world

WORLD = "# M\u00f6bel\nmap_m: [2, 2]\ntexels_per_m: 8\nobjects:\n  - {kind: room, size: [4, 4, 3], name: B\u00fcro}\n"
TEXTURED = (
    "map_m: [1, 1]\nlight: {ambient: 1}\ntextures:\n  it: {kind: image, file: NAME}\n"
    "objects:\n  - {kind: rug, at: [0, 0], size: [1, 1], texture: it}\n"
)
TRIANGLE = "mtllib a.mtl\nv 0 0 0\nv 4 0 0\nv 0 4 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_world_files_in_unicode_are_read(write, encoding):
    for text in (WORLD, WORLD.replace("\n", "\r\n")):
        assert load_world(write(text.encode(encoding))).areas[0].name == "B\u00fcro"


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (WORLD.encode("latin-1"), "line 1: a letter is not in UTF-8; save the world file as UTF-8 text"),
        (WORLD.replace("\u00f6", "").encode("latin-1"), "line 5: a letter is not in UTF-8"),
        (WORLD.replace("  -", "\t-"), "line 5: a tab is in it, and YAML is indented by blanks"),
    ],
)
def test_world_files_in_other_encodings_are_told_so(write, data, sentence):
    with pytest.raises(DataError, match=sentence):
        load_world(write(data))


@pytest.mark.parametrize(("written", "there"), [("NFC", "NFD"), ("NFD", "NFC"), ("NFC", "NFC")])
def test_names_with_accents_are_found_however_they_are_composed(write, tmp_path, written, there):
    folder = tmp_path / unicodedata.normalize(there, "B\u00f6den")
    folder.mkdir()
    Image.new("RGB", (2, 2), (9, 8, 7)).save(folder / unicodedata.normalize(there, "h\u00f6lzern.png"))
    name = unicodedata.normalize(written, "B\u00f6den/h\u00f6lzern.png")
    assert np.all(baked_pictures(load_world(write(TEXTURED.replace("NAME", name))))[0] == (9, 8, 7))
    write(f"newmtl a\nmap_Kd {name}\n", "a.mtl")
    world = load_world(write(TRIANGLE, "a.obj"))
    assert world.notes == []
    assert "1 textures found, 0 missing" in world.contents[0]
