"""Small worlds and mesh files for the tests of the mirror."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from omnilab_mirror.scene.meshes.mesh_file import read_mesh

SMALL = """\
map_m: [2, 2]
texels_per_m: 32
light:
  ambient: 0.5
  lamps:
    - {at: [0.5, 0, 2.5], power: 1, reach_m: 2}
textures:
  boards: {kind: wood, color: [160, 110, 70]}
objects:
  - {kind: room, size: [4, 4, 3], floor: boards, ceiling: [220, 220, 220], north: boards}
  - {kind: box, name: crate, at: [0.8, 0.8], size: [0.4, 0.4, 1.5], texture: [200, 40, 40]}
  - kind: face
    corners: [[-1, 1, 0], [1, 1, 0], [1, 1, 1], [-1, 1, 1]]
    texture: [40, 40, 200]
"""


@pytest.fixture
def small() -> str:
    """The text of a world file."""
    return SMALL


@pytest.fixture
def write(tmp_path):
    """Writes a world file and returns its path as `Mirror.world` takes it."""

    def write(text: str, name: str = "world.yaml") -> str:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return str(tmp_path / name)

    return write


@pytest.fixture
def save(tmp_path):
    """Writes a mesh of the given arguments of trimesh.Trimesh and returns its path."""

    def save(name: str, **arguments) -> str:
        trimesh.Trimesh(**arguments, process=False).export(tmp_path / name)
        return str(tmp_path / name)

    return save


# ------------------------------------------------------------------------------------------------ mesh files
TYPES = {
    np.dtype(t): code
    for t, code in (("i1", 5120), ("u1", 5121), ("i2", 5122), ("u2", 5123), ("u4", 5125), ("f4", 5126))
}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
POINTS = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]], np.float32)  # y is up: a wall
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)  # red, green above blue, yellow


class Glb:
    """A file being written."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.data = b""

    def add(self, kind: str, item: dict[str, Any]) -> int:
        self.json.setdefault(kind, []).append(item)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **more) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        start, self.data = len(self.data), self.data + data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **more})

    def accessor(self, values: np.ndarray, **more) -> int:
        rows = values.reshape(len(values), -1)
        item = {"bufferView": self.view(rows.tobytes()), "componentType": TYPES[rows.dtype], "count": len(rows)}
        return self.add("accessors", {**item, "type": WIDTHS[rows.shape[1]], **more})

    def image(self, pixels: np.ndarray, form: str = "PNG") -> int:
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, form, **({"lossless": True} if form == "WEBP" else {}))
        return self.add("images", {"bufferView": self.view(stream.getvalue()), "mimeType": f"image/{form.lower()}"})

    def wall(self, **attributes: int) -> dict[str, Any]:
        """A primitive of 4 x 3 m, its mesh and its node."""
        part = {"attributes": {"POSITION": self.accessor(POINTS), **attributes}, "indices": self.accessor(FACES)}
        self.add("nodes", {"mesh": self.add("meshes", {"primitives": [part]})})
        return part

    def with_material(self, content: dict[str, Any]) -> Glb:
        """The file, whose first primitive has this material."""
        self.json["meshes"][0]["primitives"][0]["material"] = self.add("materials", content)
        return self

    def bytes(self) -> bytes:
        if self.data and "buffers" not in self.json:
            self.json["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        rest = self.data + b"\0" * (-len(self.data) % 4)
        rest = struct.pack("<I4s", len(rest), b"BIN\0") + rest if rest else b""
        return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


@pytest.fixture
def new_glb():
    """Begins a GLB file."""
    return Glb


@pytest.fixture
def pictured_glb():
    """Writes a wall whose corners all lie at the upper left of a picture of four colours, lower right by their second UV set."""

    def pictured(reference: dict[str, Any], form: str = "PNG", source: dict[str, Any] | None = None, **content) -> Glb:
        glb = Glb()
        corner, other = (np.full((4, 2), x, np.float32) for x in (0.25, 0.75))
        glb.wall(TEXCOORD_0=glb.accessor(corner), TEXCOORD_1=glb.accessor(other))
        image = glb.image(FOUR, form)
        glb.add("textures", source if source is not None else {"source": image})
        pbr = {"baseColorTexture": {"index": 0, **reference}}
        return glb.with_material({"pbrMetallicRoughness": pbr} if "extensions" not in content else content)

    return pictured


@pytest.fixture
def read_glb(tmp_path):
    """Saves a GLB file and reads it."""

    def read(glb: Glb | bytes, up: str | None = "z"):
        (tmp_path / "a.glb").write_bytes(glb if isinstance(glb, bytes) else glb.bytes())
        return read_mesh(tmp_path / "a.glb", up)

    return read


@pytest.fixture
def area():
    """The area of all triangles of a mesh file."""
    return lambda mesh: float(np.linalg.norm(mesh.triangles.normals.astype(float), axis=1).sum()) / 2


@pytest.fixture
def shown():
    """The colours in the middles of the triangles of a mesh file, each once, in order."""

    def shown(mesh) -> list[tuple[int, ...]]:
        t, colors = mesh.triangles, set()
        for picture, uv, tint in zip(t.picture, t.uv.mean(axis=1), t.colors.mean(axis=1), strict=True):
            h, w, _ = t.pictures[picture].shape
            x, y = int(uv[0] % 1 * w) % w, int(uv[1] % 1 * h) % h
            colors.add(tuple(np.rint(t.pictures[picture][y, x] * (tint / 255)).astype(int).tolist()))
        return sorted(colors)

    return shown
