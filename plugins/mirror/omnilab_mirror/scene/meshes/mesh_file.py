"""Mesh files, OBJ, GLB and PLY. Nothing outside the mesh's folder is read, nothing is downloaded."""

from __future__ import annotations

import errno
import hashlib
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab_mirror.scene.file_stamps import Stamp, stamp_of
from omnilab_mirror.scene.meshes.glb import read_glb
from omnilab_mirror.scene.meshes.mesh_materials import MeshMaterials
from omnilab_mirror.scene.meshes.obj import read_obj
from omnilab_mirror.scene.meshes.ply import read_ply
from omnilab_mirror.scene.meshes.triangles import Triangles, joined

log = logging.getLogger("omnilab")
READERS: dict[str, Callable[[bytes, MeshMaterials, int], Iterable[Triangles]]] = {
    ".obj": read_obj,
    ".glb": read_glb,
    ".ply": read_ply,
}
STARTS = {  # of files that have another ending than they should
    b"ply\n": ("a PLY file", ".ply"),
    b"ply\r": ("a PLY file", ".ply"),
    b"glTF": ("a GLB file", ".glb"),
    b"solid ": ("an STL file", "convert it to .obj, .glb or .ply"),
    b"version https://git-lfs": ("a pointer of Git LFS", "fetch the file itself with 'git lfs pull'"),
    b"\x1f\x8b": ("compressed by gzip", "unpack it"),
    b"PK\x03\x04": ("a ZIP archive", "unpack it"),
}
READERS_VERSION = 2  # part of the digest: raise it when the same files give other triangles
MAX_BYTES = {".obj": 500_000_000, ".glb": 1_500_000_000, ".ply": 1_500_000_000}
MAX_TRIANGLES = 12_000_000
FARTHEST = 1e12  # from 0: products of such coordinates are still numbers
MAX_UV = 1e6  # what is farther from the picture has no digits left to place it
Z_UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds."""

    triangles: Triangles  # z up, in the file's unit
    origin: Floats  # (3,) of the triangles in the file, z up: not 0 where it has them far from 0
    digest: str  # of the file, its materials and its textures
    up: str  # its axis that points up, "y" or "z"
    content: str  # how many triangles, materials and textures
    notes: list[str]  # what was left out, mended or read otherwise than written
    sources: dict[Path, Stamp]  # all files that were read, with `stamp_of` each


def read_mesh(file: Path, up: str | None = None) -> MeshFile:
    """The triangles of a mesh file, rotated so that z is up; `up`: the file's axis (None: y in GLB, else z).

    DataError, in a sentence, where the file is not what its format has or too large.
    """
    suffix = file.suffix.lower()
    if suffix not in READERS:
        raise DataError(f"{file} has the ending '{file.suffix}'; meshes are read from .obj, .glb and .ply: convert it")
    stamp, data, materials = stamp_of(file), _bytes(file), MeshMaterials(file)
    for start, (kind, advice) in STARTS.items():
        if data.startswith(start) and advice != suffix:
            done = f"give it the ending {advice}" if advice in READERS else advice
            raise DataError(f"{file} is {kind}, by its first bytes; {done}")
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is reported
        parts = [part for part in READERS[suffix](data, materials, MAX_TRIANGLES) if len(part)]
        if not parts:
            raise DataError(f"{file} holds no triangles; export the mesh with its faces")
        triangles = _sound(materials, joined(parts))
    notes = [f"{count} {text}" for text, count in materials.notes.items() if count]
    if materials.missing:
        named = ", ".join(f"'{name}' ({why})" for name, why in sorted(materials.missing.items())[:5])
        notes.insert(0, f"{len(materials.missing)} textures or materials are missing, grey stands in: {named}")
    for note in notes:
        log.warning("%s: %s", file, note)
    digest = hashlib.blake2b(READERS_VERSION.to_bytes(4, "little"), digest_size=16)
    digest.update(data)
    for path in sorted(materials.files):
        digest.update(materials.files[path])
    content = (
        f"{file.name}: {len(triangles)} triangles, {materials.count} materials, {len(materials.found)} textures found,"
        f" {len(materials.missing)} missing"
    )
    up = up or ("y" if suffix == ".glb" else "z")
    turned = triangles.moved(Z_UP[up], np.zeros(3))
    origin = Z_UP[up] @ (np.zeros(3) if materials.origin is None else materials.origin)
    return MeshFile(turned, origin, digest.hexdigest(), up, content, notes, materials.stamps | {file: stamp})


def _bytes(file: Path) -> bytes:
    limit = MAX_BYTES[file.suffix.lower()]
    try:
        return content_of(file, limit)
    except OSError as error:
        large = error.errno == errno.EFBIG
        remedy = "decimate the mesh, or save it as binary PLY or GLB" if large else "correct the path"
        raise DataError(f"{file} cannot be read ({error.strerror}); {remedy}") from None


def _sound(materials: MeshMaterials, triangles: Triangles) -> Triangles:
    """The triangles that have an area, and how many have none; DataError where vertices are not numbers."""
    if not triangles.is_finite:
        finite = np.isfinite(triangles.corners).all(axis=(1, 2))
        name = triangles.names[triangles.name[np.argmin(finite)]]
        raise DataError(
            f"{materials.file}: {np.sum(~finite)} triangles, the first in '{name}', have a corner that is NaN or infinite;"
            " clean the mesh"
        )
    low, high = triangles.bounds
    farthest = max(np.abs(low).max(), np.abs(high).max())
    if farthest > FARTHEST:
        raise DataError(f"{materials.file} has a corner at {farthest:.3g}, up to {FARTHEST:g} is read; clean the mesh")
    flat = triangles.twice_areas < 1e-12
    if flat.all():
        raise DataError(f"{materials.file}: none of its {len(flat)} triangles has an area; is it scaled to metres?")
    if not (triangles.uv.min() >= -MAX_UV and triangles.uv.max() <= MAX_UV):  # NaN, too
        lost = np.asarray(~(np.abs(triangles.uv) <= MAX_UV).all(axis=(1, 2)))
        text = f"triangles have texture coordinates that are NaN, infinite or above {MAX_UV:g}, read as 0"
        materials.notes[text] += int(lost.sum())
        triangles = replace(triangles, uv=np.where(lost[:, None, None], np.float32(0), triangles.uv))
    materials.notes["triangles without an area were left out"] += int(flat.sum())
    return triangles[~flat] if flat.any() else triangles
