"""Materials of OBJ files: MTL files, of which the diffuse colour and its picture are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.file_kinds import has_longer_line
from omnilab_mirror.scene.meshes.mesh_materials import GREY, MeshMaterials
from omnilab_mirror.scene.pictures import BROKEN

OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1, "-bm": 1}
OPTIONS |= {"-mm": 2, "-type": 1, "-colorspace": 1}  # how many words follow each option of a picture
LONGEST_LINE = 2**16  # bytes; no name of a file is so long
TINT = 12  # of 255: how far from grey a colour is that a texture should take
VECTORS = {"-o", "-s", "-t"}  # followed by one to three numbers


@dataclass
class Material:
    """A diffuse colour and the picture that replaces it."""

    color: Bytes = field(default_factory=lambda: np.array(GREY, np.uint8))
    texture: str = ""  # the name of its file
    uv_scale: Floats = field(default_factory=lambda: np.ones(2))
    uv_offset: Floats = field(default_factory=lambda: np.zeros(2))


def text_of(data: bytes) -> str:
    """Text that is UTF-8, or else Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_mtl(libraries: Sequence[str], materials: MeshMaterials) -> dict[str, Material]:
    """The materials of the files that the `mtllib` lines name, each one file whose name may have blanks, or several."""
    known: dict[str, Material] = {}
    for line in dict.fromkeys(libraries):
        for name in _names(line, materials):
            try:
                data = materials.beside(name)
            except BROKEN as error:
                materials.lacks(name, error)
                continue
            if data[:2] in {b"\xff\xfe", b"\xfe\xff"}:
                materials.lacks(name, ValueError("it is UTF-16; save it as UTF-8 text"))
                continue
            if has_longer_line(data.replace(b"\\\n", b"  "), LONGEST_LINE):
                materials.lacks(name, ValueError(f"it has a line of more than {LONGEST_LINE} bytes"))
                continue
            for title, material in _materials(text_of(data.removeprefix(b"\xef\xbb\xbf")), materials).items():
                known.setdefault(title, material)
    materials.count = len(known)
    return known


def _names(line: str, materials: MeshMaterials) -> list[str]:
    try:
        materials.beside(line)
    except BROKEN:
        return line.split() or [line]
    return [line]


def _materials(text: str, materials: MeshMaterials) -> dict[str, Material]:
    found: dict[str, Material] = {}
    current = Material()
    transparent = set()
    for raw in text.replace("\\\n", " ").splitlines():
        word, _, rest = raw.replace("\t", " ").strip().partition(" ")
        key, rest = word.lower(), rest.strip()
        if key == "newmtl":
            current = found[rest] = Material()
        elif key == "kd":
            current.color = _color(rest, materials)
        elif key == "map_kd":
            _set_texture(current, rest, materials)
        elif (key == "d" and _number(rest, 1) < 1) or (key == "tr" and _number(rest, 0) > 0) or key == "map_d":
            transparent.add(id(current))
    materials.notes["materials are transparent and are shown opaque"] += len(transparent)
    tinted = sum(bool(material.texture) and bool(np.ptp(material.color) > TINT) for material in found.values())
    materials.notes["materials have a colour (Kd) beside their texture, which is shown without"] += tinted
    return found


def _color(rest: str, materials: MeshMaterials) -> Bytes:
    """Kd r g b, or one number for all three."""
    try:
        values = [float(word) for word in rest.partition("#")[0].split()]
    except ValueError:
        values = []
    if len(values) not in {1, 3}:
        materials.notes["colours of materials (Kd) are not r g b from 0 to 1, grey stands in"] += 1
        return np.array(GREY, np.uint8)
    return np.asarray(materials.colors(np.array([values * (3 // len(values))]))[0])


def _set_texture(material: Material, rest: str, materials: MeshMaterials) -> None:
    """map_Kd [options] name, which may have blanks."""
    name = rest.strip('"')
    if name.startswith("-"):
        words = name.split()
        while words and words[0].lower() in OPTIONS.keys() | VECTORS:
            option = words.pop(0).lower()
            if option in VECTORS:
                numbers: list[float] = []
                while words and len(numbers) < 3 and _is_number(words[0]):
                    numbers.append(float(words.pop(0)))
                if option == "-t":
                    materials.notes["textures with turbulence (-t) are shown without"] += 1
                elif option == "-o":
                    material.uv_offset = np.array([*numbers, 0.0, 0.0][:2])
                else:
                    material.uv_scale = np.array([*numbers, *[1.0] * (2 - len(numbers))][:2])
            else:
                if option == "-clamp" and words[:1] == ["on"]:
                    materials.notes["textures that end at their edges (-clamp) are repeated"] += 1
                del words[: OPTIONS[option]]
        name = " ".join(words)
    material.texture = name


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _number(word: str, default: float) -> float:
    first = word.partition(" ")[0]
    return float(first) if _is_number(first) else default
