"""Objects of a world file. A new kind is a function here, which reads its keys and adds quads, and a line in `OBJECTS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from omnilab.errors import DataError
from omnilab_mirror.scene.architecture import area, building, cylinder, door, tree, wall
from omnilab_mirror.scene.meshes.hints import ENTRY, hints
from omnilab_mirror.scene.model import Model, name_of, place_of
from omnilab_mirror.scene.nearby_files import file_below
from omnilab_mirror.scene.quads import Area, Place, Quad
from omnilab_mirror.scene.textures.procedural import paint_of
from omnilab_mirror.scene.world_yaml import Section

WALLS = {  # the direction to the wall, and to the right as one faces it
    "north": ((0, 1), (1, 0)),
    "south": ((0, -1), (-1, 0)),
    "east": ((1, 0), (0, -1)),
    "west": ((-1, 0), (0, 1)),
}


def room(s: Section, model: Model) -> None:
    """Floor, ceiling and four walls around the origin: `size` (x, y, height)."""
    size = np.array(s.size("size", 3))
    x, y, z = size * [0.5, 0.5, 1]
    model.room = np.array([[-x, -y, 0], [x, y, z]])
    model.areas.append(Area(name_of(s), model.room[0], model.room[1], walled=True))
    level = Place(np.zeros(3), 0.0)
    model.quads.append(level.quad((-x, -y, 0), (2 * x, 0, 0), (0, 2 * y, 0), paint_of(s, "floor", model.paints)))
    ceiling = level.quad((-x, y, z), (2 * x, 0, 0), (0, -2 * y, 0), paint_of(s, "ceiling", model.paints))
    model.quads.append(Quad(ceiling.corner, ceiling.u, ceiling.v, ceiling.paint, overhead=True))
    for name, (towards, right) in WALLS.items():
        middle, along = np.array([*towards, 0]) * size / 2, np.array([*right, 0]) * size / 2
        model.quads.append(level.quad(middle - along, 2 * along, (0, 0, z), paint_of(s, name, model.paints)))


def panel(s: Section, model: Model) -> None:
    """A picture, door or window on a wall: `at` (x or y of its middle, height of its lower edge), `size`."""
    towards, right = (np.array([*d, 0.0]) for d in WALLS[s.choice("wall", WALLS)])
    (along, bottom), (width, height) = s.numbers("at", 2), s.size("size", 2)
    if model.room is None:
        raise s.wrong("hangs on a wall, but no room comes before it; list the room first")
    half = model.room[1]
    if abs(along) + width / 2 > abs(right) @ half or bottom < 0 or bottom + height > half[2]:
        raise s.wrong(f"at [{along:g}, {bottom:g}] with size [{width:g}, {height:g}] reaches beyond its wall; move it")
    # some millimetres into the room: in one plane with the wall, they would shine through each other
    middle = towards * (half - s.number("depth_m", 0.005, 0.001, 1)) + abs(right) * along
    corner = middle * [1, 1, 0] - right * (width / 2) + [0, 0, bottom]
    model.quads.append(Quad(corner, right * width, np.array([0, 0, height]), paint_of(s, "texture", model.paints)))


def rug(s: Section, model: Model) -> None:
    """A flat thing on the floor, or at height `z`: `at` (x, y), `size` (x, y)."""
    place, (x, y) = place_of(s), s.size("size", 2)
    paint = paint_of(s, "texture", model.paints)
    model.quads.append(place.quad((-x / 2, -y / 2, 0.004), (x, 0, 0), (0, y, 0), paint))


def box(s: Section, model: Model) -> None:
    """A box, shelf or cupboard: `at` (x, y), `z` of its bottom, `size`; its `front` is at -y before it is rotated."""
    place, size = place_of(s), np.array(s.size("size", 3))
    low, high = size * [-0.5, -0.5, 0], size * [0.5, 0.5, 1]
    paint = paint_of(s, "texture", model.paints)
    front, top = (paint_of(s, key, model.paints) if key in s else None for key in ("front", "top"))
    model.box(place, low, high, paint, front, top)
    model.solid(name_of(s), place, low, high)


def table(s: Section, model: Model) -> None:
    """A board on four legs."""
    place, (x, y, z) = place_of(s), s.size("size", 3)
    paint, leg = paint_of(s, "texture", model.paints), s.number("leg_m", 0.06, 0.001, 1)
    model.box(place, (-x / 2, -y / 2, z - 0.04), (x / 2, y / 2, z), paint)
    _legs(model, place, (x, y, z - 0.04), leg, s)
    model.solid(name_of(s), place, (-x / 2, -y / 2, 0), (x / 2, y / 2, z))


def chair(s: Section, model: Model) -> None:
    """A seat on four legs with a back; one sits facing -y before it is rotated."""
    place, (x, y, z) = place_of(s), s.size("size", 3, [0.45, 0.45, 0.9])
    paint = paint_of(s, "texture", model.paints)
    model.box(place, (-x / 2, -y / 2, z / 2 - 0.05), (x / 2, y / 2, z / 2), paint)
    model.box(place, (-x / 2, y / 2 - 0.04, z / 2), (x / 2, y / 2, z), paint)
    _legs(model, place, (x, y, z / 2 - 0.05), 0.04, s)
    model.solid(name_of(s), place, (-x / 2, -y / 2, 0), (x / 2, y / 2, z))


def plant(s: Section, model: Model) -> None:
    """A pot with leaves that lean outwards: `size` (width, height)."""
    place, (width, height) = place_of(s), s.size("size", 2)
    leaves, r = paint_of(s, "texture", model.paints), width / 2
    model.box(place, (-r / 2, -r / 2, 0), (r / 2, r / 2, height / 4), paint_of(s, "pot", model.paints, (150, 80, 50)))
    count = int(s.number("leaves", 9, 1, 100))
    for i in range(count):
        angle = 2 * np.pi * i / count
        out, side = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        lean = r * (0.35 + 0.65 * ((i * 5) % 7) / 6)
        tip = out * lean + [0, 0, height * (0.75 - 0.25 * lean / r)]
        model.quads.append(
            place.quad(out * r / 8 - side * width / 12 + [0, 0, height / 4], side * width / 6, tip, leaves)
        )
    model.solid(name_of(s), place, (-r, -r, 0), (r, r, height))


def quad(s: Section, model: Model) -> None:
    """One parallelogram: its four `corners`, counter-clockwise as seen from the front."""
    corners = np.array(s.points("corners"), float).reshape(-1, 3)
    if len(corners) != 4:
        raise s.invalid("corners", corners.tolist(), f"4 corners, not {len(corners)}; split it into parallelograms")
    u, v, diagonal = corners[1] - corners[0], corners[3] - corners[0], corners[2] - corners[0]
    area = np.linalg.norm(np.cross(u, v))
    if area < 1e-6:
        raise s.invalid("corners", corners.tolist(), "a face with an area, but these corners lie on a line")
    if abs(np.cross(u, v) @ diagonal) / area > 1e-4:
        raise s.invalid("corners", corners.tolist(), "4 corners in one plane; move one or split the face")
    if np.linalg.norm(u + v - diagonal) > 1e-4:
        raise s.invalid("corners", corners.tolist(), "a parallelogram, whose opposite edges are equal")
    model.quads.append(Quad(corners[0], u, v, paint_of(s, "texture", model.paints)))


def mesh(s: Section, model: Model) -> None:
    """A mesh file (.obj, .glb, .ply) beside or below the world file: `at` (x, y) of its origin, `scale` to metres, `up`."""
    from omnilab_mirror.scene.meshes.mesh_file import MAX_TRIANGLES, read_mesh

    name, place, scale = s.word("file"), place_of(s), s.number("scale", 1.0, 1e-6, 1e6)
    try:
        file = file_below(s.file.parent, name)
    except ValueError as error:
        expected = f"a file in the folder of the world file, or below it ({error}); move the mesh there"
        raise s.invalid("file", name, expected) from None
    up = s.choice("up", ("y", "z")) if "up" in s else None
    try:
        found = model.files[file, up] if (file, up) in model.files else read_mesh(file, up)
    except DataError as error:
        raise s.wrong(f"has a mesh that cannot be used: {error}") from None
    model.files[file, up] = found
    total = len(found.triangles) + sum(len(mesh.triangles) for mesh in model.meshes)
    if total > MAX_TRIANGLES:
        raise s.wrong(f"is one mesh too many: {total} triangles are in the world, {MAX_TRIANGLES} may be; remove some")
    in_metres = found.triangles if scale == 1 else found.triangles.moved(scale * np.eye(3), np.zeros(3))
    questions = list(hints(in_metres, found.up, scale, ENTRY))
    turned = scale * place.rotation
    triangles = found.triangles.moved(turned, turned @ found.origin + place.at)
    if "name" in s:
        triangles = replace(triangles, names=[s.word("name")] * len(triangles.names))
    notes = found.notes + [f"'{name}': {question}" for question in questions]
    model.meshes.append(replace(found, triangles=triangles, notes=notes))


OBJECTS: dict[str, Callable[[Section, Model], None]] = {
    "area": area,
    "box": box,
    "building": building,
    "chair": chair,
    "cylinder": cylinder,
    "door": door,
    "face": quad,
    "mesh": mesh,
    "panel": panel,
    "plant": plant,
    "room": room,
    "rug": rug,
    "table": table,
    "tree": tree,
    "wall": wall,
}


def add_object(s: Section, number: int, model: Model) -> None:
    """Add what a section of `objects` describes. `number`: what its textures draw from, whatever else is in the world."""
    before = len(model.quads)
    OBJECTS[s.choice("kind", OBJECTS)](s, model)
    name = name_of(s)
    s.done()
    for i, quad in enumerate(model.quads[before:]):
        model.quads[before + i] = replace(quad, name=name, seed=(number, i))


def _legs(model: Model, place: Place, size: tuple[float, float, float], leg: float, s: Section) -> None:
    x, y, z = size
    paint = paint_of(s, "legs", model.paints) if "legs" in s else paint_of(s, "texture", model.paints)
    for right in (-x / 2, x / 2 - leg):
        for back in (-y / 2, y / 2 - leg):
            model.box(place, (right, back, 0), (right + leg, back + leg, z), paint)
