"""The data of a GLB file: its JSON, its buffers and the accessors into them, all checked before they are used."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from omnilab.errors import DataError
from omnilab_mirror.scene.meshes.mesh_materials import MeshMaterials
from omnilab_mirror.scene.pictures import BROKEN

Array = npt.NDArray[Any]
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSIONS = {  # in which triangles or textures are hidden from whoever does not know them
    "KHR_draco_mesh_compression": "Draco compression",
    "EXT_meshopt_compression": "meshopt compression",
    "KHR_meshopt_compression": "meshopt compression",
    "KHR_texture_basisu": "Basis Universal textures",
    "EXT_mesh_gpu_instancing": "instances of a mesh",
}
MAX_JSON = 64_000_000  # bytes
READ = {"KHR_texture_transform", "KHR_mesh_quantization", "EXT_texture_webp"}
LOOKS = ("KHR_materials_", "KHR_lights_", "KHR_xmp", "KHR_animation_", "EXT_lights_", "ADOBE_materials_")  # no shapes


class GltfError(Exception):
    """What is wrong with the file."""


class Gltf:
    """A GLB file's JSON and buffers."""

    def __init__(self, data: bytes, materials: MeshMaterials, limit: int) -> None:
        self.materials, self.limit = materials, limit
        self.json, self.chunk = _chunks(data)
        self._buffers: dict[int, bytes] = {}
        version = str(_object(self.json.get("asset", {})).get("version", ""))
        if not version.startswith("2"):
            raise GltfError(f"it is of version {version or '?'} of glTF, and 2.0 is read")
        for name in _array(self.json.get("extensionsRequired", [])):
            if name not in READ and not str(name).startswith(LOOKS):
                known = f" ({COMPRESSIONS[name]})" if name in COMPRESSIONS else ""
                raise self.needs(f"{name}{known}")

    def needs(self, extension: str) -> DataError:
        """The error of an extension without which the mesh cannot be read."""
        return DataError(
            f"{self.materials.file} needs the glTF extension {extension}, which is not read; export the mesh without it"
        )

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """An object of one of the JSON's lists."""
        items = _array(self.json.get(kind, []))
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(items):
            raise GltfError(f"it refers to {kind} {index}, and has {len(items)}")
        return _object(items[index])

    def view(self, index: Any) -> tuple[memoryview, int | None]:
        """The bytes of a buffer view, and how far apart its items are."""
        view = self.item("bufferViews", index)
        start, length = whole(view.get("byteOffset", 0)), whole(view.get("byteLength"))
        try:
            buffer = self._buffer(view.get("buffer"))
        except GltfError:
            for name, compression in COMPRESSIONS.items():
                if name in extensions_of(view):
                    raise self.needs(f"{name} ({compression})") from None
            raise
        if start + length > len(buffer):
            raise GltfError(f"bufferViews {index} ends beyond its buffer of {len(buffer)} bytes")
        stride = view.get("byteStride")
        return memoryview(buffer)[start : start + length], None if stride is None else whole(stride)

    def _buffer(self, index: Any) -> bytes:
        buffer = self.item("buffers", index)
        if index not in self._buffers:
            if "uri" in buffer:
                self._buffers[index] = self.file(str(buffer["uri"]))
            elif index == 0 and self.chunk is not None:
                self._buffers[index] = self.chunk
            else:
                raise GltfError(f"there is no data of its buffers {index}")
        return self._buffers[index]

    def file(self, uri: str) -> bytes:
        """The content of a data URI, or of a file in the mesh's folder."""
        try:
            if uri.startswith("data:"):
                return base64.b64decode(uri.partition(",")[2], validate=True)
            return self.materials.beside(unquote(uri))
        except BROKEN as error:  # that of base64 is a ValueError
            cause = str(getattr(error, "strerror", None) or error)
            raise GltfError(f"its file '{uri[:60]}' cannot be had: {cause}") from None

    def accessor(self, index: Any) -> Array:
        """The rows (n, width) of an accessor: floats, or integers, which are as fractions where they are normalized."""
        found = self.item("accessors", index)
        count, kind = whole(found.get("count")), COMPONENTS.get(found.get("componentType", 0))
        width = WIDTHS.get(found.get("type", ""))
        if kind is None or width is None:
            raise GltfError(f"accessors {index} has a type that is not in glTF 2.0")
        if count > 3 * self.limit:
            raise GltfError(f"accessors {index} has {count} rows, up to {3 * self.limit} are read")
        dtype = np.dtype(kind)
        if "bufferView" in found:
            rows = self._rows(found["bufferView"], found.get("byteOffset", 0), count, width, dtype, index)
        else:
            rows = np.zeros((count, width), dtype)
        if sparse := found.get("sparse"):
            rows = self._with_sparse(rows.copy(), _object(sparse), width, dtype, index)
        if found.get("normalized") and dtype.kind in "iu":
            return np.maximum(rows / np.iinfo(dtype).max, -1.0)
        return rows

    def _with_sparse(self, rows: Array, sparse: dict[str, Any], width: int, dtype: np.dtype[Any], index: Any) -> Array:
        where, values = _object(sparse.get("indices")), _object(sparse.get("values"))
        count, kind = whole(sparse.get("count")), COMPONENTS.get(where.get("componentType", 0))
        if kind is None or count > len(rows):
            raise GltfError(f"accessors {index} has {count} sparse values for {len(rows)} rows")
        at = self._rows(where.get("bufferView"), where.get("byteOffset", 0), count, 1, np.dtype(kind), index)[:, 0]
        if count and (at.dtype.kind != "u" or at.max() >= len(rows)):
            raise GltfError(f"accessors {index} has a sparse value for row {at.max()} of {len(rows)}")
        rows[at] = self._rows(values.get("bufferView"), values.get("byteOffset", 0), count, width, dtype, index)
        return rows

    def _rows(self, view: Any, offset: Any, count: int, width: int, dtype: np.dtype[Any], index: Any) -> Array:
        data, stride = self.view(view)
        start, size = whole(offset), width * dtype.itemsize
        step = stride or size
        if count and (step < size or start + step * (count - 1) + size > len(data)):
            raise GltfError(f"accessors {index} ends beyond its buffer view of {len(data)} bytes")
        if not count:
            return np.empty((0, width), dtype)
        return np.ndarray((count, width), dtype, data, start, (step, dtype.itemsize))


def whole(value: Any) -> int:
    """A count or place in the file."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**53:
        raise GltfError(f"it has {str(value)[:40]!r} where a whole number from 0 should be")
    return value


def numbers(value: Any, count: int, default: Any = None) -> Array:
    """A list of finite numbers (count,)."""
    if value is None and default is not None:
        value = default
    if not isinstance(value, list) or len(value) != count or not all(isinstance(x, (int, float)) for x in value):
        raise GltfError(f"it has {str(value)[:40]!r} where {count} numbers should be")
    result = np.array(value, float)
    if not np.isfinite(result).all():
        raise GltfError(f"it has {str(value)[:40]!r} where {count} finite numbers should be")
    return result


def extensions_of(item: dict[str, Any]) -> dict[str, Any]:
    """The extensions of an object, by name."""
    return _object(item.get("extensions", {}))


def _object(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise GltfError(f"it has {str(value)[:40]!r} where an object should be")
    return value


def _array(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise GltfError(f"it has {str(value)[:40]!r} where a list should be")
    return value


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The JSON and, if there is one, the first chunk of bytes."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise GltfError("it does not begin with 'glTF'")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise GltfError(f"it is of version {version} of GLB, and 2 is read")
    if length > len(data):
        raise GltfError(f"it has {len(data)} of {length} bytes")
    size, kind = struct.unpack_from("<I4s", data, 12)
    if kind != b"JSON" or 20 + size > length:
        raise GltfError("it does not begin with JSON")
    if size > MAX_JSON:
        raise GltfError(f"its JSON has {size} bytes, up to {MAX_JSON} are read")
    try:
        text = json.loads(data[20 : 20 + size])
    except (ValueError, RecursionError):
        raise GltfError("its JSON cannot be read") from None
    start = 20 + size
    if start + 8 > length:
        return _object(text), None
    size, kind = struct.unpack_from("<I4s", data, start)
    if start + 8 + size > length:
        raise GltfError(f"its chunk of {size} bytes ends beyond the file")
    return _object(text), data[start + 8 : start + 8 + size] if kind == b"BIN\0" else None
