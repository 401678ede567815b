"""Materials of a mesh file: pictures, texture coordinates on each triangle, and colours of the corners."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals, to_rgba
from trimesh.visual.material import PBRMaterial

from omnilab.api import Bytes
from omnilab.errors import DataError

Array = npt.NDArray[Any]
GREY = (160, 160, 160)  # of what has no colour
MAX_PIXELS = 64_000_000  # of one texture
MAX_TEXELS = 200_000_000  # of all of them
WHITE = np.full((1, 1, 3), 255, np.uint8)


@dataclass
class MeshMaterials:
    """The materials of one file as pictures, each decoded once."""

    file: Path
    missing: dict[str, str]  # takes the textures that cannot be decoded, with the reason
    pictures: dict[Any, Bytes] = field(default_factory=dict)
    images: list[Any] = field(default_factory=list)  # keeps the identities that are keys of `pictures` alive

    def of(self, mesh: trimesh.Trimesh, faces: Array) -> tuple[Bytes, Array, Bytes]:
        """Picture (h, w, 3), places on it (T, 3, 2) float32, and colours (T, 3, 3) of the faces (T, 3) of a mesh."""
        nowhere = np.zeros((*faces.shape, 2), np.float32)
        if not isinstance(mesh.visual, TextureVisuals):
            return WHITE, nowhere, self._vertex_colors(mesh, faces)
        visual, material = mesh.visual, mesh.visual.material
        colors = visual.vertex_attributes.get("color") if visual.vertex_attributes else None
        tint = np.full((*faces.shape, 3), 255, np.uint8) if colors is None else self._srgb(_bytes(colors))[faces]
        image = material.baseColorTexture if isinstance(material, PBRMaterial) else getattr(material, "image", None)
        if image is None or visual.uv is None:
            return self._plain(self._color(material)), nowhere, tint
        uv = np.asarray(visual.uv, np.float32)[faces][..., :2] * np.array([1, -1], np.float32) + np.array(
            [0, 1], np.float32
        )
        factor = material.baseColorFactor if isinstance(material, PBRMaterial) else None
        return self._texture(image, None if factor is None else self._color(material)), np.nan_to_num(uv), tint

    def _vertex_colors(self, mesh: trimesh.Trimesh, faces: Array) -> Bytes:
        if mesh.visual.kind == "vertex":
            return self._srgb(_bytes(mesh.visual.vertex_colors))[faces]
        if mesh.visual.kind == "face":
            return np.repeat(_bytes(mesh.visual.face_colors)[:, None], 3, axis=1)
        return np.full((*faces.shape, 3), GREY, np.uint8)

    def _color(self, material: Any) -> Bytes:
        if isinstance(material, PBRMaterial):
            factor = np.array([255, 255, 255]) if material.baseColorFactor is None else material.baseColorFactor
            return np.asarray(self._srgb(_bytes(np.asarray(factor)[None]))[0])
        return np.asarray(_bytes(np.asarray(material.main_color)[None])[0])

    def _srgb(self, colors: Bytes) -> Bytes:
        """GLB has colours linear in light, unlike its pictures (glTF 2.0, 3.9.2); IEC 61966-2-1 is what images show."""
        if self.file.suffix.lower() != ".glb":
            return colors
        c = colors / 255
        return np.asarray(np.rint(255 * np.where(c < 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)), np.uint8)

    def _plain(self, color: Bytes) -> Bytes:
        return self.pictures.setdefault(color.tobytes(), color.reshape(1, 1, 3))

    def _texture(self, image: Image.Image, tint: Bytes | None) -> Bytes:
        """The pixels of an image, multiplied by a colour."""
        key = id(image), None if tint is None else tint.tobytes()
        if key not in self.pictures:
            self.images.append(image)
            pixels = self._pixels(image)
            self.pictures[key] = pixels if tint is None else np.rint(pixels * (tint / 255)).astype(np.uint8)
            if sum(picture.size // 3 for picture in self.pictures.values()) > MAX_TEXELS:
                raise DataError(f"{self.file} has textures of more than {MAX_TEXELS} pixels; make them smaller")
        return self.pictures[key]

    def _pixels(self, image: Image.Image) -> Bytes:
        name = str(image.info.get("file_path", "a texture"))
        if image.width * image.height > MAX_PIXELS:
            raise DataError(f"{self.file}: '{name}' has {image.width} x {image.height} pixels, {MAX_PIXELS} may be read;"
                            " make it smaller")  # fmt: skip
        try:
            return np.asarray(image.convert("RGB"))
        except (OSError, ValueError, SyntaxError) as error:
            self.missing[name] = str(error)
            return np.full((1, 1, 3), GREY, np.uint8)


def _bytes(colors: Array) -> Bytes:
    """RGB (N, 3) uint8 of colours (N, 3 or 4) of any kind."""
    return np.asarray(to_rgba(colors)[:, :3])
