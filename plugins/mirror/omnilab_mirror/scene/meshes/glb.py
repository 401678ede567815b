"""GLB files, binary glTF 2.0: the meshes of its scene where its nodes place them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab.errors import DataError
from omnilab_mirror.scene.meshes.gltf_data import COMPRESSIONS, Gltf, GltfError, extensions_of, numbers
from omnilab_mirror.scene.meshes.gltf_materials import GltfMaterials
from omnilab_mirror.scene.meshes.mesh_materials import GREY, WHITE, MeshMaterials, linear_to_srgb
from omnilab_mirror.scene.meshes.triangles import Array, Triangles, one_part

TRIANGLES, STRIP, FAN = 4, 5, 6
DRACO = "KHR_draco_mesh_compression"
INSTANCES = "EXT_mesh_gpu_instancing"
MAX_NODES = 1_000_000
UNMOVED = np.eye(4)
BENT = "meshes are bent by bones or morphs, and are shown as they are without"


def read_glb(data: bytes, materials: MeshMaterials, limit: int) -> Iterator[Triangles]:
    """The triangles of a GLB file, those of each primitive together; DataError says what is wrong with it."""
    try:
        gltf = Gltf(data, materials, limit)
        placed = _placed(gltf)
        made, total = GltfMaterials(gltf), 0
        for mesh, transforms in placed.items():
            for primitive in _primitives(gltf, mesh):
                faces = _faces(gltf, primitive)
                total += len(faces) * len(transforms)
                if total > limit:
                    raise DataError(
                        f"{materials.file} has {total} triangles or more, {limit} may be read; decimate the mesh"
                    )
                if len(faces):
                    title = str(gltf.item("meshes", mesh).get("name") or materials.file.name)
                    T = np.array(transforms)
                    mirrored = np.linalg.det(T[:, :3, :3]) < 0  # then the other side is the front (glTF 2.0, 3.7.4)
                    if not mirrored.all():
                        yield _part(gltf, primitive, faces, T[~mirrored], title, made)
                    if mirrored.any():
                        yield _part(gltf, primitive, faces[:, ::-1], T[mirrored], title, made)
    except GltfError as error:
        raise DataError(f"{materials.file} is no whole GLB file ({error}); save it again") from None
    except (TypeError, AttributeError, KeyError, ValueError, OverflowError):  # JSON of another shape
        raise DataError(
            f"{materials.file} is no whole GLB file (its JSON is not that of glTF 2.0); save it again"
        ) from None


def _placed(gltf: Gltf) -> dict[int, list[Floats]]:
    """Where the scene's nodes show each mesh: matrices (4, 4). Nodes are a forest, as glTF 2.0 has it (3.5.2)."""
    nodes = gltf.json.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise GltfError(f"it has {len(nodes)} nodes, up to {MAX_NODES} are read")
    scenes = gltf.json.get("scenes", [])
    if scenes:
        roots = gltf.item("scenes", gltf.json.get("scene", 0)).get("nodes", [])
        gltf.materials.notes["further scenes are not shown"] += len(scenes) - 1
    else:
        below = {child for node in nodes for child in node.get("children", [])}
        roots = [i for i in range(len(nodes)) if i not in below]
    placed: dict[int, list[Floats]] = {}
    seen: set[int] = set()
    waiting = [(root, UNMOVED) for root in reversed(roots)]
    while waiting:
        index, above = waiting.pop()
        node = gltf.item("nodes", index)
        if index in seen:
            raise GltfError(f"nodes {index} is below itself or below two others")
        seen.add(index)
        T = above @ _matrix(node)
        if "mesh" in node:
            placed.setdefault(node["mesh"], []).append(T)
            gltf.materials.notes[BENT] += "skin" in node or "weights" in node
            gltf.materials.notes[f"instances of a mesh ({INSTANCES}) are not shown but once"] += (
                INSTANCES in extensions_of(node)
            )
        waiting += [(child, T) for child in reversed(node.get("children", []))]
    return placed


def _matrix(node: dict[str, Any]) -> Floats:
    """A node's own transform (4, 4)."""
    if "matrix" in node:
        return numbers(node["matrix"], 16).reshape(4, 4).T
    if not node.keys() & {"rotation", "scale", "translation"}:
        return UNMOVED
    T = np.eye(4)
    x, y, z, w = numbers(node.get("rotation"), 4, [0, 0, 0, 1])
    n = x * x + y * y + z * z + w * w
    if n == 0:
        raise GltfError("a node has a rotation of 0 0 0 0")
    R = np.array([
        [1 - 2 * (y * y + z * z) / n, 2 * (x * y - z * w) / n, 2 * (x * z + y * w) / n],
        [2 * (x * y + z * w) / n, 1 - 2 * (x * x + z * z) / n, 2 * (y * z - x * w) / n],
        [2 * (x * z - y * w) / n, 2 * (y * z + x * w) / n, 1 - 2 * (x * x + y * y) / n],
    ])  # fmt: skip
    T[:3, :3] = R * numbers(node.get("scale"), 3, [1, 1, 1])
    T[:3, 3] = numbers(node.get("translation"), 3, [0, 0, 0])
    return T


def _primitives(gltf: Gltf, mesh: Any) -> list[dict[str, Any]]:
    """Those of a mesh that are triangles."""
    found = gltf.item("meshes", mesh)
    gltf.materials.notes[BENT] += "weights" in found
    shown = [part for part in found.get("primitives", []) if part.get("mode", TRIANGLES) in {TRIANGLES, STRIP, FAN}]
    gltf.materials.notes["sets of points or lines were left out"] += len(found.get("primitives", [])) - len(shown)
    for part in shown:
        if "POSITION" not in part.get("attributes", {}):
            raise GltfError("a mesh has no positions")
        position = gltf.item("accessors", part["attributes"]["POSITION"])
        if DRACO in extensions_of(part) and "bufferView" not in position and "sparse" not in position:
            raise gltf.needs(f"{DRACO} ({COMPRESSIONS[DRACO]})")
    return shown


def _faces(gltf: Gltf, primitive: dict[str, Any]) -> Ints:
    """The vertices of each triangle (T, 3)."""
    count = gltf.item("accessors", primitive["attributes"]["POSITION"]).get("count", 0)
    if "indices" in primitive:
        index = gltf.accessor(primitive["indices"])[:, 0]
        if index.dtype.kind != "u":
            raise GltfError("its indices are not whole numbers from 0")
        index = np.require(index, requirements=["C", "ALIGNED"])
        if len(index) and index.max() >= count:
            raise GltfError(f"a triangle has the vertex {index.max()}, and there are {count}, from 0")
    else:
        index = np.arange(min(int(count), 3 * gltf.limit + 3))
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLES:
        gltf.materials.notes["indices are left over, since triangles have three"] += len(index) % 3
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(index) - 2, 0))
    if mode == FAN:
        return np.column_stack([index[i + 1], index[i + 2], np.broadcast_to(index[:1], len(i)) if len(i) else i])
    return np.column_stack([index[i], index[i + 1 + i % 2], index[i + 2 - i % 2]])


def _part(
    gltf: Gltf, primitive: dict[str, Any], faces: Ints, transforms: Floats, title: str, made: GltfMaterials
) -> Triangles:
    """The triangles of a primitive as often as it is shown."""
    attributes = primitive["attributes"]
    points = gltf.accessor(attributes["POSITION"]).astype(float)
    if points.shape[1] != 3:
        raise GltfError("its positions are not of three numbers")
    moved = np.einsum("nij,vj->nvi", transforms[:, :3, :3], points) + transforms[:, None, :3, 3]
    copies = [gltf.materials.placed(seen, faces) for seen in moved]
    corners = copies[0] if len(copies) == 1 else np.concatenate(copies)
    tint, uv, picture = _tint(gltf, attributes, len(points)), None, WHITE
    if "material" not in primitive:
        tint = np.broadcast_to(np.array(GREY, np.uint8), points.shape) if tint is None else tint
    else:
        material = made.of(primitive["material"])
        picture = material.picture
        if material.places and material.places not in attributes:
            text = "triangles have a texture but no texture coordinates, and take their material's colour"
            gltf.materials.notes[text] += len(faces)
            picture = material.plain
        elif material.places:
            places = gltf.accessor(attributes[material.places]).astype(float)
            if places.shape != (len(points), 2):
                raise GltfError("it has other texture coordinates than positions")
            uv = (places @ material.transform[:, :2].T + material.transform[:, 2]).astype(np.float32)
            beyond = ((uv < 0) | (uv > 1))[faces].any(axis=(1, 2))
            text = "triangles go beyond the edge of a picture that ends or is mirrored there, and are shown with it repeated"
            gltf.materials.notes[text] += int(beyond.sum()) if material.clamped else 0
    shown = len(transforms)
    part = one_part(corners, _shown(uv, faces, shown), _shown(tint, faces, shown), picture, title)
    return replace(part, name=np.repeat(np.arange(shown, dtype=np.int32), len(faces)), names=[title] * shown)


def _shown(values: Array | None, faces: Ints, shown: int) -> Array | None:
    """What is given for each vertex (V, n), at the corners of the faces (T, 3), `shown` times."""
    if values is None:
        return None
    if values.strides[0] == 0:
        return np.broadcast_to(values[0], (shown * len(faces), 3, values.shape[1]))
    return np.tile(values[faces], (shown, 1, 1))


def _tint(gltf: Gltf, attributes: dict[str, Any], count: int) -> Bytes | None:
    """Colours (V, 3) of the vertices, which are linear in light, unlike pictures (glTF 2.0, 3.7.2.1)."""
    if "COLOR_0" not in attributes:
        return None
    colors = gltf.accessor(attributes["COLOR_0"])
    if len(colors) != count or colors.shape[1] not in {3, 4}:
        raise GltfError("it has other colours than positions")
    if colors.dtype.kind in "ui":  # though they should be marked as fractions
        colors = colors / np.iinfo(colors.dtype).max
    return np.rint(255 * linear_to_srgb(colors[:, :3].astype(float))).astype(np.uint8)
