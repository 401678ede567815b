"""Wavefront OBJ files and their MTL files of materials."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab.errors import DataError
from omnilab.file_kinds import has_longer_line
from omnilab_mirror.scene.meshes.corners import rows_at
from omnilab_mirror.scene.meshes.mesh_materials import GREY, WHITE, MeshMaterials
from omnilab_mirror.scene.meshes.mtl import Material, read_mtl, text_of
from omnilab_mirror.scene.meshes.obj_faces import INDEX, OTHER, parse_faces
from omnilab_mirror.scene.meshes.obj_scan import Scan, scanned
from omnilab_mirror.scene.meshes.polygons import split
from omnilab_mirror.scene.meshes.triangles import Triangles, one_part

LONGEST_LINE = 2**20  # bytes; a face of so many corners is none
CHUNK = 16_000_000  # bytes that are taken apart at once
END = -1.2345e300  # stands at the end of each line of numbers while they are read
SILENT = {b"vn", b"vp", b"g", b"s", b"#", b"", b"mg", b"lod", b"maplib", b"usemap", b"bevel", b"c_interp", b"d_interp"}
SILENT |= {b"shadow_obj", b"trace_obj", b"ctech", b"stech"}
NOT_READ = {  # and counted
    b"p": "points or lines were left out",
    b"l": "points or lines were left out",
    b"curv": "free-form curves or surfaces were left out",
    b"curv2": "free-form curves or surfaces were left out",
    b"surf": "free-form curves or surfaces were left out",
}


@dataclass
class ObjFile:
    """What the lines of an OBJ file hold, in order."""

    vertices: list[Floats] = field(default_factory=list)  # (n, 3) or, with colours, (n, 6), NaN where there is none
    places: list[Floats] = field(default_factory=list)  # (n, 2), the `vt`
    vertex: list[Ints] = field(default_factory=list)  # of each corner, from 1
    place: list[Ints] = field(default_factory=list)  # of each corner, from 1; 0 is none
    counts: list[Ints] = field(default_factory=list)  # corners of each face
    group: list[Ints] = field(default_factory=list)  # of each face
    line: list[Ints] = field(default_factory=list)  # of each face
    groups: dict[tuple[str | None, str | None], int] = field(default_factory=dict)  # (material, object)
    libraries: list[str] = field(default_factory=list)
    triangles: int = 0  # that the faces make


def read_obj(data: bytes, materials: MeshMaterials, limit: int) -> Iterator[Triangles]:
    """The triangles of an OBJ file, those of each object and material together; DataError says what is wrong with it."""
    if data[:2] in {b"\xff\xfe", b"\xfe\xff"} or b"\0" in data[:1000]:
        raise DataError(f"{materials.file} is no whole OBJ file (it is UTF-16 or binary); save it as UTF-8 text")
    if has_longer_line(data, LONGEST_LINE):
        raise DataError(
            f"{materials.file} is no whole OBJ file (it has a line of more than {LONGEST_LINE} bytes); save it again"
        )
    obj = _lines_read(_plain_text(data), materials, limit)
    if not obj.counts or not sum(map(len, obj.counts)):
        return
    yield from _parts(obj, materials)


def _plain_text(data: bytes) -> bytes:
    """The text with one kind of line ends and of blanks, and lines that go on behind a backslash joined."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data.replace(b"\t", b" ") if b"\t" in data else data


def _lines_read(text: bytes, materials: MeshMaterials, limit: int) -> ObjFile:
    reader = _Reader(materials)
    for part in _chunks(text):
        found = scanned(part, reader.vertices, reader.places)
        if found is None:
            _take(reader.obj, reader.sort(part.split(b"\n")), materials, limit)
        else:
            reader.take(part, found)
            _check_count(reader.obj, materials, limit)
    return reader.obj


def _chunks(text: bytes) -> Iterator[bytes]:
    """Whole lines of the text, some megabytes at once, parted between two that a backslash joins only where too many are."""
    start = 0
    while start < len(text):
        end = text.find(b"\n", start + CHUNK)
        while 0 < end < start + CHUNK + 2 * LONGEST_LINE and text[end - 1 : end] == b"\\":
            end = text.find(b"\n", end + 1)
        yield text[start : end if end >= 0 else len(text)]
        start = end + 1 if end >= 0 else len(text)


def _joined(lines: list[bytes], first: int, materials: MeshMaterials) -> Iterator[tuple[int, bytes]]:
    """Lines with those that a backslash joins to them, and the number of the last of each; DataError for too long ones."""
    parts, size = list[bytes](), 0
    for number, line in enumerate(lines, first):
        if not line.endswith(b"\\"):
            yield number, b" ".join([*parts, line]) if parts else line
            parts, size = [], 0
            continue
        parts.append(line[:-1])
        size += len(line)
        if size > LONGEST_LINE:
            raise DataError(
                f"{materials.file} is no whole OBJ file (lines up to {number}, which backslashes join, have more than"
                f" {LONGEST_LINE} bytes); save it again"
            )


@dataclass
class _Chunk:
    """What follows the words `v`, `vt` and `f` of some lines, their line numbers, and the group of each face."""

    v: list[bytes] = field(default_factory=list)
    vt: list[bytes] = field(default_factory=list)
    f: list[bytes] = field(default_factory=list)
    v_line: list[int] = field(default_factory=list)
    vt_line: list[int] = field(default_factory=list)
    f_line: list[int] = field(default_factory=list)
    f_group: list[int] = field(default_factory=list)


@dataclass
class _Reader:
    """Sorts lines by their words, and remembers what earlier ones said."""

    materials: MeshMaterials
    obj: ObjFile = field(default_factory=ObjFile)
    current: tuple[str | None, str | None] = (None, None)  # material and object of the faces to come
    number: int = 0  # of the last line
    vertices: int = 0  # of the chunks before
    places: int = 0

    def sort(self, lines: list[bytes]) -> _Chunk:
        """The lines of a chunk by their words; what is not read is counted."""
        chunk = _Chunk()
        v, vt, f = chunk.v, chunk.vt, chunk.f
        for number, whole in _joined(lines, self.number + 1, self.materials):
            word, _, rest = whole.strip().partition(b" ")
            if word == b"v":
                v.append(rest)
                chunk.v_line.append(number)
            elif word in {b"f", b"fo"}:
                if b"-" in rest:
                    rest = _counted_from_1(rest, self.vertices + len(v), self.places + len(vt))
                f.append(rest)
                chunk.f_line.append(number)
                chunk.f_group.append(self.obj.groups.setdefault(self.current, len(self.obj.groups)))
            elif word == b"vt":
                vt.append(rest)
                chunk.vt_line.append(number)
            else:
                self._state(word, rest)
        self.number += len(lines)
        self.vertices, self.places = self.vertices + len(v), self.places + len(vt)
        return chunk

    def take(self, text: bytes, found: Scan) -> None:
        """Keep what was found in some lines."""
        group, start = np.empty(len(found.counts), np.int32), 0
        for at, faces in [*found.others.tolist(), (len(text), len(group))]:
            if faces > start:
                group[start:faces] = self.obj.groups.setdefault(self.current, len(self.obj.groups))
                start = faces
            if at < len(text):
                end = text.find(b"\n", at)
                word, _, rest = text[at : end if end >= 0 else len(text)].strip().partition(b" ")
                self._state(word, rest)
        obj, line = self.obj, found.line + np.int32(self.number + 1)
        pairs: list[tuple[list[Any], Any]] = [
            (obj.vertices, found.vertices), (obj.places, found.places), (obj.vertex, found.vertex), (obj.place, found.place),
            (obj.counts, found.counts), (obj.group, group), (obj.line, line),
        ]  # fmt: skip
        for kept, new in pairs:
            if len(new):
                kept.append(new)
        obj.triangles += int(np.maximum(found.counts - 2, 0).sum())
        self.number += text.count(b"\n") + 1
        self.vertices, self.places = self.vertices + len(found.vertices), self.places + len(found.places)

    def _state(self, word: bytes, rest: bytes) -> None:
        """A line that is about those to come, or that is not read."""
        if word == b"usemtl":
            self.current = text_of(rest.strip()), self.current[1]
        elif word == b"o":
            self.current = self.current[0], text_of(rest.strip())
        elif word == b"mtllib":
            self.obj.libraries.append(text_of(rest.strip()))
        elif word in NOT_READ:
            self.materials.notes[NOT_READ[word]] += 1
        elif word not in SILENT and not word.startswith(b"#"):
            self.materials.notes["lines of unknown kinds were left out"] += 1


def _take(obj: ObjFile, chunk: _Chunk, materials: MeshMaterials, limit: int) -> None:
    """Read the numbers of a chunk."""
    if chunk.v:
        obj.vertices.append(_numbers(chunk.v, chunk.v_line, 3, materials))
    if chunk.vt:
        obj.places.append(_numbers(chunk.vt, chunk.vt_line, 2, materials))
    if chunk.f:
        vertex, place, counts = _faces(chunk.f, chunk.f_line, materials)
        obj.triangles += int(np.maximum(counts - 2, 0).sum())
        _check_count(obj, materials, limit)
        obj.vertex.append(vertex)
        obj.place.append(place)
        obj.counts.append(counts)
        obj.group.append(np.array(chunk.f_group, np.int32))
        obj.line.append(np.array(chunk.f_line, np.int32))


def _check_count(obj: ObjFile, materials: MeshMaterials, limit: int) -> None:
    if obj.triangles > limit:
        raise DataError(f"{materials.file} has {obj.triangles} triangles, {limit} may be read; decimate the mesh")


def _counted_from_1(corners: bytes, vertices: int, places: int) -> bytes:
    """Corners whose negative indices, counted back from the last vertex so far, are counted from the first."""
    known = (vertices, places, 0)
    words = []
    for corner in corners.partition(b"#")[0].split():
        parts = corner.split(b"/")
        for i, part in enumerate(parts[:3]):
            if part.startswith(b"-") and part[1:].isdigit() and i < 2:
                parts[i] = b"%d" % max(known[i] + 1 - int(part[1:18]), 0)
        words.append(b"/".join(parts[:2]))
    return b" ".join(words)


def _numbers(lines: list[bytes], at: list[int], least: int, materials: MeshMaterials) -> Floats:
    """The numbers (n, 3) of positions, (n, 6) where some have colours, or (n, 2) of texture coordinates."""
    end = b" %r " % END
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            flat = np.fromstring(end.join([*lines, b""]), sep=" ")
        table = flat.reshape(len(lines), least + 1)
        if (table[:, -1] == END).all() and not (table[:, :-1] == END).any():
            return table[:, :-1]
    except (ValueError, DeprecationWarning):
        pass  # not all alike: line by line
    rows = [_row(line, number, least, materials) for line, number in zip(lines, at, strict=True)]
    return np.array(rows, float)


def _row(line: bytes, number: int, least: int, materials: MeshMaterials) -> list[float]:
    """Three coordinates and a colour, NaN where there is none; or two texture coordinates."""
    words = line.partition(b"#")[0].split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if least == 2:
        if not 1 <= len(values) <= 3:
            raise _wrong(materials, number, line, "1 to 3 texture coordinates after 'vt'")
        return [*values, 0.0][:2]
    if not 3 <= len(values) <= 8:
        raise _wrong(materials, number, line, "3 coordinates after 'v', or those and a colour")
    color = values[3:6] if len(values) >= 6 else [np.nan] * 3
    return values[:3] + color


def _wrong(materials: MeshMaterials, number: int, line: bytes, expected: str) -> DataError:
    found = text_of(line.strip())[:60]
    return DataError(
        f"{materials.file} is no whole OBJ file (line {number} has {found!r} instead of {expected}); save it again"
    )


def _faces(lines: list[bytes], at: list[int], materials: MeshMaterials) -> tuple[Ints, Ints, Ints]:
    """Indices, from 1, of the vertex and the texture coordinate of each corner, and how many corners each face has."""
    text = np.frombuffer(b"\n".join([*lines, b""]), np.uint8)
    vertex, place = (np.empty(len(text) // 2 + 1, np.int32) for _ in range(2))
    counts = np.empty(len(lines), np.int32)
    found, line, problem = parse_faces(text, vertex, place, counts)
    if problem == OTHER:
        raise _wrong(materials, at[line], lines[line], "corners such as 1, 1/2, 1//3 or 1/2/3 after 'f'")
    if problem == INDEX:
        raise DataError(
            f"{materials.file} is no whole OBJ file (line {at[line]}: a face has the index 0, and indices start at 1);"
            " save it again"
        )
    return vertex[:found].copy(), place[:found].copy(), counts


def _parts(obj: ObjFile, materials: MeshMaterials) -> Iterator[Triangles]:
    vertices, colors = _stacked(obj.vertices, materials)
    places = np.concatenate([*obj.places, np.empty((0, 2))])
    vertex, place = np.concatenate(obj.vertex), np.concatenate(obj.place)
    counts, group, line = np.concatenate(obj.counts), np.concatenate(obj.group), np.concatenate(obj.line)
    for index, last, what in ((vertex, len(vertices), "vertex"), (place, len(places), "texture coordinate")):
        if np.max(index, initial=0) > last:
            first = int(np.argmax(index > last))
            face = int(np.searchsorted(np.cumsum(counts), first, side="right"))
            raise DataError(
                f"{materials.file} is no whole OBJ file (line {line[face]}: there is no {what} {index[first]}, only {last});"
                " save it again"
            )
    materials.notes["faces of fewer than three corners were left out"] += int(np.sum(counts < 3))
    triangles = split(vertices[:, :3], vertex - 1, counts)
    materials.notes["polygons that cross themselves were read as fans of triangles"] += triangles.crossing
    known = read_mtl(obj.libraries, materials)
    at, on = triangles.of_corners(vertex - 1), triangles.of_corners(place)
    group = triangles.of_polygons(group)
    # as they have always been: what comes last in the file comes first
    order = np.argsort(-group, kind="stable") if len(obj.groups) > 1 else np.arange(len(group))
    ends = np.searchsorted(-group[order], -np.arange(len(obj.groups) - 1, -1, -1), side="right")
    unknown = sorted({name for name, _ in obj.groups if name is not None and name not in known})
    if unknown and (known or not obj.libraries):
        materials.notes[f"materials are in none of its .mtl files, grey stands in: {', '.join(unknown[:5])}"] = len(
            unknown
        )
    start = 0
    for (name, thing), end in zip(reversed(obj.groups), ends.tolist(), strict=True):
        rows = order[start:end] if len(obj.groups) > 1 else slice(None)
        title = "_".join(word for word in (thing, name if len(known) > 1 else None) if word) or materials.file.name
        start = end
        yield from _part(vertices, colors, at[rows], on[rows], places, known.get(name or ""), title, materials)


def _part(
    vertices: Floats,
    colors: Bytes,
    at: Ints,
    on: Ints,
    places: Floats,
    material: Material | None,
    title: str,
    materials: MeshMaterials,
) -> Iterator[Triangles]:
    """Triangles (T, 3) of one object and material; those without a place on its texture are apart."""
    if material is None:
        yield one_part(materials.placed(vertices, at), None, _tints(colors, at), WHITE, title)
        return
    placed = (on > 0).all(axis=(1,)) if material.texture else np.zeros(len(at), bool)
    if placed.any():
        uv = places[on[placed] - 1] * material.uv_scale + material.uv_offset
        down = uv.astype(np.float32) * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)
        picture = materials.texture(material.texture)
        yield one_part(materials.placed(vertices, at[placed]), down, None, picture, title)
    if not placed.all():
        if material.texture:
            text = "triangles have a texture but no texture coordinates, and take their material's colour"
            materials.notes[text] += int(np.sum(~placed))
        yield one_part(materials.placed(vertices, at[~placed]), None, None, materials.plain(material.color), title)


def _tints(colors: Bytes, at: Ints) -> Bytes:
    if colors.strides[0] == 0:
        return np.broadcast_to(colors[0], (*at.shape, 3))
    tints = np.empty((*at.shape, 3), np.uint8)
    rows_at(np.ascontiguousarray(colors), np.ascontiguousarray(at), tints)
    return tints


def _stacked(parts: list[Floats], materials: MeshMaterials) -> tuple[Floats, Bytes]:
    """Positions (V, 3) and colours (V, 3), grey where the file has none."""
    vertices = np.concatenate([*(part[:, :3] for part in parts), np.empty((0, 3))])
    colors = np.broadcast_to(np.array(GREY, np.uint8), vertices.shape)
    if any(part.shape[1] > 3 for part in parts):
        given = np.concatenate([part[:, 3:] if part.shape[1] > 3 else np.full_like(part, np.nan) for part in parts])
        some = ~np.isnan(given).all(axis=1)
        colors = np.where(some[:, None], materials.colors(np.where(some[:, None], given, 0)), colors)
    return vertices, colors
