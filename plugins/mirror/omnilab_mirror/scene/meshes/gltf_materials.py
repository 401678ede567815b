"""Materials of glTF: the base colour or the diffuse colour, its picture, and where on it a corner lies."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_mirror.scene.meshes.gltf_data import COMPRESSIONS, Gltf, GltfError, extensions_of, numbers, whole
from omnilab_mirror.scene.meshes.mesh_materials import linear_to_srgb

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
TRANSFORM = "KHR_texture_transform"
REPEAT = 10497


class GltfMaterial(NamedTuple):
    """What of a material is shown."""

    picture: Bytes  # (h, w, 3)
    plain: Bytes  # (1, 1, 3): its colour, where there are no texture coordinates
    places: str  # the attribute that has the texture coordinates, "" without a picture
    transform: Floats  # (2, 3), of texture coordinates (x, y, 1)
    clamped: bool  # the picture ends at its edges, or is mirrored there


class GltfMaterials:
    """The materials of a file, each made once, since others may share its picture."""

    def __init__(self, gltf: Gltf) -> None:
        self.gltf = gltf
        self.made: dict[int, GltfMaterial] = {}

    def of(self, index: Any) -> GltfMaterial:
        """A material by its number."""
        material = self.gltf.item("materials", index)
        if index not in self.made:
            self.made[index] = self._material(material)
            self.gltf.materials.count = len(self.made)
        return self.made[index]

    def _material(self, material: dict[str, Any]) -> GltfMaterial:
        notes, extensions = self.gltf.materials.notes, extensions_of(material)
        see_through = material.get("alphaMode", "OPAQUE") != "OPAQUE" or "KHR_materials_transmission" in extensions
        notes["materials are transparent and are shown opaque"] += see_through
        emits = "emissiveTexture" in material or np.any(numbers(material.get("emissiveFactor"), 3, [0, 0, 0]) > 0)
        notes["materials glow by themselves, which is not shown"] += bool(emits)
        if SPECULAR_GLOSSINESS in extensions:
            part, factor, texture = extensions[SPECULAR_GLOSSINESS], "diffuseFactor", "diffuseTexture"
        else:
            part, factor, texture = material.get("pbrMetallicRoughness", {}), "baseColorFactor", "baseColorTexture"
        if not isinstance(part, dict):
            raise GltfError("it has a material that is no object")
        color = linear_to_srgb(numbers(part.get(factor), 4, [1, 1, 1, 1])[:3])
        plain = self.gltf.materials.plain(np.rint(255 * color).astype(np.uint8))
        if texture not in part:
            return GltfMaterial(plain, plain, "", np.eye(3)[:2], False)
        reference = part[texture]
        if not isinstance(reference, dict):
            raise GltfError("it has a texture that is no object")
        moved = extensions_of(reference).get(TRANSFORM, {})
        places = f"TEXCOORD_{whole(moved.get('texCoord', reference.get('texCoord', 0)))}"
        picture, clamped = self._picture(reference.get("index"), None if np.all(color == 1) else color)
        return GltfMaterial(picture, plain, places, _matrix(moved), clamped)

    def _picture(self, index: Any, factor: Floats | None) -> tuple[Bytes, bool]:
        texture, materials = self.gltf.item("textures", index), self.gltf.materials
        sampler = self.gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
        clamped = any(sampler.get(wrap, REPEAT) != REPEAT for wrap in ("wrapS", "wrapT"))
        extensions = extensions_of(texture)
        source = extensions.get("EXT_texture_webp", texture).get("source", texture.get("source"))
        if source is None:
            name = next((f"{COMPRESSIONS[name]}, {name}" for name in extensions if name in COMPRESSIONS), "nothing")
            materials.lacks(f"texture {index}", ValueError(f"it has {name}, which is not read"))
            return materials.texture(f"texture {index}", factor, b""), clamped
        image = self.gltf.item("images", source)
        name = f"image {source}.png"
        if "bufferView" in image:
            return materials.texture(name, factor, bytes(self.gltf.view(image["bufferView"])[0])), clamped
        uri = str(image.get("uri", ""))
        name = name if uri.startswith("data:") else uri
        try:
            return materials.texture(name, factor, self.gltf.file(uri)), clamped
        except GltfError as error:
            materials.lacks(name, ValueError(str(error).rpartition(": ")[2]))
            return materials.texture(name, factor, b""), clamped


def _matrix(transform: dict[str, Any]) -> Floats:
    """KHR_texture_transform as a matrix (2, 3): scaled, turned counter-clockwise as one sees the picture, and moved.

    The matrix that is printed in the extension turns the other way, against its text and all implementations
    (KhronosGroup/glTF#1563).
    """
    (x, y), (u, v) = numbers(transform.get("offset"), 2, [0, 0]), numbers(transform.get("scale"), 2, [1, 1])
    (angle,) = numbers([transform.get("rotation", 0)], 1)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * u, s * v, x], [-s * u, c * v, y]])
