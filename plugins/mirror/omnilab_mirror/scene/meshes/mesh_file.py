"""Mesh files, OBJ, GLB and PLY, read by trimesh. Nothing outside the mesh's folder is read, nothing is downloaded."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import re
import struct
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

from omnilab.errors import DataError
from omnilab_mirror.scene.file_stamps import Stamp, stamp_of
from omnilab_mirror.scene.meshes.mesh_materials import GREY, MAX_PIXELS, MeshMaterials
from omnilab_mirror.scene.meshes.triangles import Triangles, joined
from omnilab_mirror.scene.nearby_files import bytes_of, file_below

log = logging.getLogger("omnilab")
Array = npt.NDArray[Any]
TYPES = {".obj": "obj", ".glb": "glb", ".ply": "ply"}
MAX_BYTES = {".obj": 500_000_000, ".glb": 1_500_000_000, ".ply": 1_500_000_000}
MAX_TRIANGLES = 12_000_000
BROKEN = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)  # what Pillow raises
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif")
Z_UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds."""

    triangles: Triangles  # z up, in metres as the file has them
    digest: str  # of the file, its materials and its textures
    up: str  # its axis that points up, "y" or "z"
    content: str  # how many triangles, materials and textures
    notes: list[str]  # what is wrong with it and could be mended
    sources: dict[Path, Stamp]  # all files that were read, with `stamp_of` each


@dataclass
class MeshFolder:
    """Gives trimesh the files beside a mesh; a grey pixel stands in for textures that cannot be had."""

    root: Path
    files: dict[Path, bytes] = field(default_factory=dict)
    stamps: dict[Path, Stamp] = field(default_factory=dict)  # of those and of the missing
    missing: dict[str, str] = field(default_factory=dict)

    def get(self, key: str) -> bytes:
        """The content of a file below the mesh's folder."""
        name = str(key).strip().strip('"').replace("\\", "/")
        try:
            return self._read(name)
        except BROKEN as error:
            self.missing.setdefault(name, _cause(error))
            if name.lower().endswith(PICTURES):
                return _grey_png()
            raise

    def _read(self, name: str) -> bytes:
        path = file_below(self.root, name)
        if path not in self.files:
            self.stamps[path] = stamp_of(path)
            data = bytes_of(path, MAX_PIXELS)
            if name.lower().endswith(PICTURES):
                Image.open(io.BytesIO(data)).verify()
            self.files[path] = data
        return self.files[path]

    __getitem__ = get


def read_mesh(file: Path, up: str | None = None) -> MeshFile:
    """The triangles of a mesh file, rotated so that z is up; `up`: the file's axis (None: y in GLB, else z)."""
    suffix = file.suffix.lower()
    if suffix not in TYPES:
        raise DataError(f"{file} has the ending '{file.suffix}'; meshes are read from .obj, .glb and .ply: convert it")
    stamp, data, folder = stamp_of(file), _bytes(file), MeshFolder(file.parent)
    scene = _scene(file, data, folder)
    triangles, notes = _sound(file, _all(file, scene, folder))
    if folder.missing:
        named = ", ".join(f"'{name}' ({why})" for name, why in sorted(folder.missing.items())[:5])
        notes.insert(0, f"{len(folder.missing)} textures or materials are missing, grey stands in: {named}")
    for note in notes:
        log.warning("%s: %s", file, note)
    digest = hashlib.blake2b(data, digest_size=16)
    for path in sorted(folder.files):
        digest.update(folder.files[path])
    up = up or ("y" if suffix == ".glb" else "z")
    textures = sum(path.suffix.lower() in PICTURES for path in folder.files)
    content = f"{file.name}: {len(triangles)} triangles, {textures} textures found, {len(folder.missing)} missing"
    return MeshFile(
        triangles.moved(Z_UP[up], np.zeros(3)), digest.hexdigest(), up, content, notes, folder.stamps | {file: stamp}
    )


def _bytes(file: Path) -> bytes:
    limit = MAX_BYTES[file.suffix.lower()]
    try:
        if file.stat().st_size > limit:
            raise DataError(f"{file} has {file.stat().st_size} bytes, {limit} may be read; decimate the mesh, or save it"
                            " as binary PLY or GLB")  # fmt: skip
        return bytes_of(file, limit)
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror}); correct the path") from None
    except ValueError as error:
        raise DataError(f"{file} cannot be read ({error}); give a file") from None


def _scene(file: Path, data: bytes, folder: MeshFolder) -> trimesh.Scene:
    kind = TYPES[file.suffix.lower()]
    options = {"split_objects": True} if kind == "obj" else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong is seen below
            data = _mended(data, folder) if kind == "glb" else data
            return trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=folder, process=False, **options)
    except Exception as error:  # noqa: BLE001  trimesh raises whatever its parsers meet
        cause = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(f"{file} is no whole {kind.upper()} file ({cause}); save it again") from None


def _mended(data: bytes, folder: MeshFolder) -> bytes:
    """A GLB file whose broken pictures are noted in `folder.missing` and referred to it: trimesh would leave them out in silence."""
    try:
        (length,) = struct.unpack_from("<I", data, 12)
        header, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
        inside = [(i, image) for i, image in enumerate(header.get("images", [])) if "bufferView" in image]
        views = [header["bufferViews"][image["bufferView"]] for _, image in inside]
        starts = [8 + view.get("byteOffset", 0) for view in views]  # after the head of the chunk
        parts = [rest[start : start + view["byteLength"]] for start, view in zip(starts, views, strict=True)]
    except (struct.error, ValueError, LookupError, TypeError, AttributeError):
        return data  # trimesh will say that the file is broken
    for (i, image), part in zip(inside, parts, strict=True):
        try:
            Image.open(io.BytesIO(part)).verify()
        except BROKEN as error:
            del image["bufferView"]
            image["uri"] = f"image {i}.png"
            folder.missing[image["uri"]] = _cause(error)
    if not folder.missing:
        return data
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


def _cause(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).split(" <")[0]


def _all(file: Path, scene: trimesh.Scene, folder: MeshFolder) -> Triangles:
    """All meshes of a scene where its graph places them."""
    nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed = [(T, name, scene.geometry[name]) for T, name in nodes]
    placed = [(T, name, mesh) for T, name, mesh in placed if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    count = sum(len(mesh.faces) for _, _, mesh in placed)
    if count == 0:
        raise DataError(f"{file} holds no triangles; export the mesh with its faces")
    if count > MAX_TRIANGLES:
        raise DataError(f"{file} has {count} triangles, {MAX_TRIANGLES} may be read; decimate the mesh")
    materials = MeshMaterials(file, folder.missing)
    return joined([_part(file, np.asarray(T), name, mesh, materials) for T, name, mesh in placed])


def _part(file: Path, T: Array, name: str, mesh: trimesh.Trimesh, materials: MeshMaterials) -> Triangles:
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise DataError(f"{file}: a face of '{name}' has no vertex {faces.max()}; save the file again")
    picture, uv, colors = materials.of(mesh, faces)
    with np.errstate(invalid="ignore", over="ignore"):  # reported by `_sound`
        corners = (vertices @ T[:3, :3].T + T[:3, 3]).astype(np.float32)[faces]
    name = file.name if re.fullmatch(r"geometry(_\d+)?", name) else name  # trimesh's word for what has no name
    none = np.zeros(len(faces), np.int32)
    return Triangles(corners, uv, none, colors, none, none.astype(bool), [picture], [name])


def _sound(file: Path, triangles: Triangles) -> tuple[Triangles, list[str]]:
    """The triangles that have an area, and how many have none; DataError where vertices are not numbers."""
    finite = np.isfinite(triangles.corners).all(axis=(1, 2))
    if not finite.all():
        name = triangles.names[triangles.name[np.argmin(finite)]]
        raise DataError(
            f"{file}: {np.sum(~finite)} triangles, the first in '{name}', have a corner that is NaN or infinite;"
            " clean the mesh"
        )
    flat = np.linalg.norm(triangles.normals, axis=1) < 1e-12
    if flat.all():
        raise DataError(f"{file}: none of its {len(flat)} triangles has an area; is it scaled to metres?")
    if not flat.any():
        return triangles, []
    return triangles[~flat], [f"{flat.sum()} triangles without an area were left out"]


def _grey_png() -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (1, 1), GREY).save(stream, "PNG")
    return stream.getvalue()
