"""Pictures and colours of a mesh file: decoded once each, within limits, as RGB of 8 bits."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats, Ints
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab_mirror.scene.file_stamps import Stamp, stamp_of
from omnilab_mirror.scene.meshes.corners import placed
from omnilab_mirror.scene.nearby_files import file_below
from omnilab_mirror.scene.pictures import BROKEN, DARK, FRACTIONS, opened

Array = npt.NDArray[Any]
GREY = (160, 160, 160)  # of what has no colour
MAX_BYTES = 64_000_000  # of a file beside the mesh
MAX_FOLDERS = 20  # in which a missing file is looked for
MAX_PIXELS = 64_000_000  # of one texture
MAX_TEXELS = 200_000_000  # of all of them
HIGHEST_SHARE = 2.0  # of colours that are fractions, a few of which may be more than 1
WHITE = np.full((1, 1, 3), 255, np.uint8)
FAR = 1e5  # from 0
OPAQUE = 250  # of 255
ORIENTATION = 0x0112  # of EXIF


@dataclass
class MeshMaterials:
    """What belongs to a mesh file: the files in its folder, its pictures, and what is noted about them."""

    file: Path
    notes: Counter[str] = field(default_factory=Counter)  # what was read otherwise than written, and how often
    files: dict[Path, bytes] = field(default_factory=dict)  # beside the mesh, that were read
    stamps: dict[Path, Stamp] = field(default_factory=dict)  # of those and of the missing
    missing: dict[str, str] = field(default_factory=dict)  # textures and materials that cannot be had, with the reason
    pictures: dict[Any, Bytes] = field(default_factory=dict)
    found: set[str] = field(default_factory=set)  # names of the textures that could be had
    origin: Floats | None = None  # (3,) of the triangles in the file: not 0 where they are far from it
    texels: int = 0  # of all pictures
    count: int = 0  # of materials

    def beside(self, name: str) -> bytes:
        """The content of a file in the mesh's folder or below; OSError or ValueError where it cannot be had."""
        path = file_below(self.file.parent, name.strip().strip('"').replace("\\", "/"))
        if path not in self.files:
            self.stamps[path] = stamp_of(path)
            try:
                self.files[path] = content_of(path, MAX_BYTES)
            except FileNotFoundError as error:
                raise ValueError(f"{error.strerror}{_there_is(self.file.parent, path.name)}") from None
        return self.files[path]

    def placed(self, points: Floats, index: Ints) -> Floats:
        """Points (V, 3) with the indices (T, 3), less `origin`, in 32 bits, which have seven digits: too few for maps in metres."""
        if self.origin is None and len(index):
            first = points[index[0, 0]]
            self.origin = np.where(np.isfinite(first) & (np.abs(first) > FAR), np.floor(first), 0.0)
        return placed(points, index, np.zeros(3) if self.origin is None else self.origin)

    def lacks(self, name: str, error: Exception) -> None:
        """Note that a texture or a file of materials cannot be had."""
        cause = str(getattr(error, "strerror", None) or error).split(" <")[0]
        self.missing.setdefault(name, cause)

    def texture(self, name: str, factor: Floats | None = None, data: bytes | None = None) -> Bytes:
        """Pixels (h, w, 3) of a picture in the mesh's folder, or of `data`, times a factor (3,); grey where it has none."""
        key = name, None if factor is None else tuple(factor)
        if key not in self.pictures:
            pixels = self._pixels(name, data)
            self.pictures[key] = pixels if factor is None else np.rint(pixels * np.asarray(factor)).astype(np.uint8)
            self.texels += pixels.size // 3
            if self.texels > MAX_TEXELS:
                raise DataError(f"{self.file} has textures of more than {MAX_TEXELS} pixels; make them smaller")
        return self.pictures[key]

    def plain(self, color: Bytes) -> Bytes:
        """A picture of one pixel of a colour (3,)."""
        return self.pictures.setdefault(color.tobytes(), color.reshape(1, 1, 3))

    def colors(self, values: Array) -> Bytes:
        """RGB (N, 3) of 8 bits of colours (N, 3 or more) of a file: integers of 8 or 16 bits, or numbers from 0 to 1."""
        values = values[:, :3]
        highest = np.nanmax(values, initial=0) if values.dtype.kind == "f" else np.max(values, initial=0)
        if values.dtype.kind == "f" and highest <= HIGHEST_SHARE:
            values = values * 255
        elif values.dtype.kind == "f":
            self.notes["sets of colours go above 1 and were read as 0 to 255"] += 1
        elif highest > 255:
            values = values / 257
        elif highest == 1:
            self.notes["sets of colours are whole numbers of 0 and 1 only, almost black among 0 to 255"] += 1
        if values.dtype == np.uint8:
            return np.ascontiguousarray(values)
        outside = ~((values >= 0) & (values <= 255)).all(axis=1)
        self.notes["colours below 0, above their largest or not a number were cut off"] += int(outside.sum())
        return np.asarray(np.rint(np.clip(np.nan_to_num(values), 0, 255)), np.uint8)

    def _pixels(self, name: str, data: bytes | None) -> Bytes:
        try:
            pixels = self._decoded(name, self.beside(name) if data is None else data)
        except BROKEN as error:
            self.lacks(name, error)
            return np.full((1, 1, 3), GREY, np.uint8)
        self.found.add(name)
        return pixels

    def _decoded(self, name: str, data: bytes) -> Bytes:
        image = opened(data)
        if image.width * image.height > MAX_PIXELS:
            raise DataError(f"{self.file}: '{name}' has {image.width} x {image.height} pixels, {MAX_PIXELS} may be read;"
                            " make it smaller")  # fmt: skip
        if image.getexif().get(ORIENTATION, 1) > 1:
            self.notes[
                "textures have an EXIF orientation, which was not applied: texture coordinates are of the pixels"
            ] += 1
        if image.has_transparency_data and self.file.suffix.lower() != ".glb":  # whose materials say whether it counts
            alpha = np.asarray(image.convert("RGBA"))[..., 3]
            self.notes["textures are transparent in parts and are shown opaque"] += bool(alpha.min() < OPAQUE)
        if image.mode == "F":
            raise ValueError(FRACTIONS)
        if image.mode.startswith("I"):  # 16 bits, which Pillow would cut off at 255
            values = np.asarray(image)
            self.notes["textures have 16 bits and use 12 or fewer, so that they are dark"] += 0 < values.max() <= DARK
            grey = np.clip(np.rint(values / 257), 0, 255).astype(np.uint8)
            return np.repeat(grey[..., None], 3, axis=2)
        return np.asarray(image.convert("RGB"))


def _there_is(folder: Path, name: str) -> str:
    """The files of a folder, and of folders in it, that are called so but for upper and lower case."""
    inside = [folder, *sorted(path for path in folder.iterdir() if path.is_dir())[:MAX_FOLDERS]]
    alike = [path for place in inside for path in place.iterdir() if path.name.lower() == name.lower()]
    return f"; there is '{alike[0].relative_to(folder)}'" if alike else ""


def linear_to_srgb(linear: Floats) -> Floats:
    """What images show, from 0 to 1, of light from 0 to 1 (IEC 61966-2-1)."""
    c = np.clip(np.nan_to_num(linear), 0, 1)
    return np.asarray(np.where(c < 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055))
