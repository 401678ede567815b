"""Stanford PLY files: polygons with colours of vertices or faces, and texture coordinates as MeshLab writes them."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab.errors import DataError
from omnilab_mirror.scene.meshes.corners import rows_at
from omnilab_mirror.scene.meshes.mesh_materials import GREY, WHITE, MeshMaterials
from omnilab_mirror.scene.meshes.ply_data import Element, Lists, PlyError, elements_of
from omnilab_mirror.scene.meshes.polygons import Split, split
from omnilab_mirror.scene.meshes.triangles import Triangles, one_part

COLORS = [("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")]
PLACES = [("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"), ("tex_u", "tex_v")]
LISTS = ("vertex_indices", "vertex_index")
COLOR_LIKE = re.compile(r"red|green|blue|colou?r|rgb|gray|grey|intensity", re.IGNORECASE)


def read_ply(data: bytes, materials: MeshMaterials, limit: int) -> Iterator[Triangles]:
    """The triangles of a PLY file; DataError says what is wrong with it."""
    try:
        comments, elements = elements_of(data, limit)
        vertices = elements.get("vertex", Element({}, 0))
        vertex, counts, faces = _polygons(elements)
        if not len(counts) and vertices.rows:
            raise DataError(
                f"{materials.file} holds no triangles, but {vertices.rows} points; make a mesh of them, with faces"
            )
        if np.maximum(counts - 2, 0).sum() > limit:
            raise DataError(
                f"{materials.file} has {np.maximum(counts - 2, 0).sum()} triangles, {limit} may be read; decimate the mesh"
            )
        points = _points(vertices)
        if len(vertex) and not 0 <= vertex.min() <= vertex.max() < len(points):
            outside = (vertex < 0) | (vertex >= len(points))
            raise PlyError(f"a face has the vertex {vertex[np.argmax(outside)]}, and there are {len(points)}, from 0")
    except PlyError as error:
        raise DataError(f"{materials.file} is no whole PLY file ({error}); save it again") from None
    materials.notes["faces of fewer than three corners were left out"] += int(np.sum(counts < 3))
    triangles = split(points, vertex, counts)
    materials.notes["polygons that cross themselves were read as fans of triangles"] += triangles.crossing
    chosen = triangles.of_corners(vertex)
    colors = _colors(vertices, faces, chosen, triangles, materials)
    uv = _places(vertices, faces, counts, triangles, chosen)
    pictures = _pictures(comments, faces, triangles, len(chosen))
    yield from _textured(materials.placed(points, chosen), uv, colors, pictures, materials)


def _points(vertices: Element) -> Floats:
    """Positions (V, 3)."""
    missing = [name for name in "xyz" if name not in vertices.scalars]
    if missing:
        raise PlyError(f"its vertices lack the property '{missing[0]}'")
    return np.column_stack([vertices.scalars[name].astype(float) for name in "xyz"])


def _polygons(elements: dict[str, Element]) -> tuple[Ints, Ints, Element]:
    """Vertices of all corners (C,), corners of each polygon (P,), and the element with the rest about the polygons."""
    faces = elements.get("face", Element({}, 0))
    found = next((faces.lists[name] for name in LISTS if name in faces.lists), None)
    if found is not None:
        values = found.values if found.values.dtype.kind in "iu" else found.values.astype(np.int64)
        return values, found.counts.astype(np.int64), faces
    strips = elements.get("tristrips", Element({}, 0))
    found = next((strips.lists[name] for name in LISTS if name in strips.lists), None)
    if found is None:
        return np.empty(0, np.int64), np.empty(0, np.int64), faces
    corners = _strips(found)
    return corners.reshape(-1), np.full(len(corners), 3), Element({}, len(corners))


def _strips(found: Lists) -> Ints:
    """The triangles (T, 3) of strips of vertices, in which -1 begins a new one; every other is turned over."""
    values = found.values.astype(np.int64)
    first = np.zeros(len(values), bool)
    first[(np.cumsum(found.counts) - found.counts)[found.counts > 0]] = True
    first |= np.concatenate([[True], values[:-1] < 0])[: len(values)]
    since = np.arange(len(values)) - np.maximum.accumulate(np.where(first, np.arange(len(values)), 0))
    last = np.nonzero((since >= 2) & (values >= 0))[0]
    corners = np.column_stack([values[last - 2], values[last - 1], values[last]])
    odd = since[last] % 2 == 1
    corners[odd] = corners[odd][:, [1, 0, 2]]
    return corners


def _colors(vertices: Element, faces: Element, chosen: Ints, split: Split, materials: MeshMaterials) -> Bytes:
    """Colours (T, 3, 3) of the corners: those of the vertices, or else of the faces, or else grey."""
    of_vertices, of_faces = _color(vertices), _color(faces)
    if of_vertices is not None:
        if of_faces is not None:
            materials.notes["colours of faces are not shown, since the vertices have colours, too"] += len(of_faces)
        colors = np.empty((*chosen.shape, 3), np.uint8)
        rows_at(materials.colors(of_vertices), chosen, colors)
        return colors
    if of_faces is not None:
        return np.repeat(split.of_polygons(materials.colors(of_faces))[:, None], 3, axis=1)
    names = [name for element in (vertices, faces) for name in element.scalars if COLOR_LIKE.search(name)]
    if names:
        text = f"properties may be colours, but are not called red, green and blue, and are not shown: {', '.join(names[:5])}"
        materials.notes[text] += len(names)
    return np.broadcast_to(np.array(GREY, np.uint8), (*chosen.shape, 3))


def _color(element: Element) -> Floats | Ints | None:
    """Colours (N, 3) under any of their names, upper or lower case."""
    named = {name.lower(): values for name, values in element.scalars.items()}
    for names in COLORS:
        if all(name in named for name in names):
            return np.column_stack([named[name] for name in names])
    return None


def _places(vertices: Element, faces: Element, counts: Ints, split: Split, chosen: Ints) -> Floats | None:
    """Texture coordinates (T, 3, 2), right and down, of the faces' corners or of the vertices; None where there are none."""
    up = None
    listed = faces.lists.get("texcoord")
    if listed is not None and np.array_equal(listed.counts, 2 * counts):
        up = split.of_corners(listed.values.reshape(-1, 2).astype(float))
    for names in PLACES:
        if up is None and all(name in vertices.scalars for name in names):
            up = np.column_stack([vertices.scalars[name].astype(float) for name in names])[chosen]
    return None if up is None else up.astype(np.float32) * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)


def _pictures(comments: list[str], faces: Element, split: Split, count: int) -> list[tuple[str, Ints]]:
    """The names of the pictures, and which triangles each is on; `texnumber` counts the comments that name them."""
    names = [comment.split(None, 1)[1] for comment in comments if re.match(r"texturefile\s+\S", comment, re.IGNORECASE)]
    number = faces.scalars.get("texnumber")
    if number is None or len(names) < 2:
        return [(name, np.arange(count)) for name in names[:1]]
    return [(name, np.nonzero(split.of_polygons(number) == i)[0]) for i, name in enumerate(names)]


def _textured(
    corners: Floats, uv: Floats | None, colors: Bytes, pictures: list[tuple[str, Ints]], materials: MeshMaterials
) -> Iterator[Triangles]:
    if uv is None and pictures:
        materials.notes["textures are not shown, since there are no texture coordinates"] += len(pictures)
    title = materials.file.name
    if uv is None or not pictures:
        yield one_part(corners, None, colors, WHITE, title)
        return
    plain = np.ones(len(corners), bool)
    for name, on in pictures:
        materials.count += 1
        plain[on] = False
        yield one_part(corners[on], uv[on], None, materials.texture(name), title)
    if plain.any():
        yield one_part(corners[plain], None, colors[plain], WHITE, title)
