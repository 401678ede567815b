"""Objects that rooms, houses and squares are built of: areas, walls with openings, doors, cylinders, buildings, trees."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from omnilab_mirror.scene.model import Model, name_of, place_of
from omnilab_mirror.scene.quads import Area, Place, Quad
from omnilab_mirror.scene.textures.canvas import Paint, Sheet
from omnilab_mirror.scene.textures.procedural import paint_of
from omnilab_mirror.scene.world_yaml import Section

SKY_M = 1000.0  # as high as an area without a ceiling reaches
CROWN = np.array([(2 * np.cos(a), 2 * np.sin(a), 1) for a in 2 * np.pi * np.arange(5) / 5])  # rhombic icosahedron


def area(s: Section, model: Model) -> None:
    """A floor that viewpoints may be above, open at its sides: `at`, `size` (x, y); with `height`, below a ceiling."""
    (x, y), (dx, dy) = s.numbers("at", 2, [0, 0]), s.size("size", 2)
    low = np.array([x - dx / 2, y - dy / 2, s.number("z", 0.0)])
    height = s.number("height", SKY_M, 0.1, SKY_M)
    model.quads.append(Quad(low, np.array([dx, 0, 0]), np.array([0, dy, 0]), paint_of(s, "floor", model.paints)))
    if "height" in s:
        paint, corner = paint_of(s, "ceiling", model.paints), np.add(low, [0, dy, height])
        model.quads.append(Quad(corner, np.array([dx, 0, 0]), np.array([0, -dy, 0]), paint, overhead=True))
    model.areas.append(Area(name_of(s), low, np.add(low, [dx, dy, height]), walled=False))


def wall(s: Section, model: Model) -> None:
    """A wall `from` a point `to` another, `height` and `thickness`, with `openings` down to the floor or above a sill.

    `texture` covers it on the right as one walks along it, `back` on the left. `free`: it is seen from its ends and from
    above, too.
    """
    start, end = np.array(s.numbers("from", 2)), np.array(s.numbers("to", 2))
    length = float(np.linalg.norm(end - start))
    if length < 0.01:
        raise s.invalid("to", end.tolist(), "a point at least a centimetre from the other end")
    height, thick = s.number("height", low=0.01, high=1000), s.number("thickness", 0.12, 0.01, 10)
    turn = float(np.arctan2(*(end - start)[::-1]))
    place = Place(np.array([*start, s.number("z", 0.0)]), turn)
    front = Sheet(paint_of(s, "texture", model.paints), (length, height))
    back = Sheet(paint_of(s, "back" if "back" in s else "texture", model.paints), (length, height))
    edge, half, name = paint_of(s, "edge" if "edge" in s else "texture", model.paints), thick / 2, name_of(s)
    holes = _holes(s, length, height)
    for x0, x1, z0, z1 in _pieces(holes, length, height):
        dx, dz = (x1 - x0, 0, 0), (0, 0, z1 - z0)
        model.quads.append(place.quad((x0, -half, z0), dx, dz, front.part(x0, z0)))
        model.quads.append(place.quad((x1, half, z0), (x0 - x1, 0, 0), dz, back.part(length - x1, z0)))
        model.solid(name, place, (x0, -half, z0), (x1, half, z1))
    for x0, x1, z0, z1 in holes:
        dx, dy, dz = (x1 - x0, 0, 0), (0, thick, 0), (0, 0, z1 - z0)
        model.quads.append(place.quad((x0, -half, z0), dy, dz, edge))
        model.quads.append(place.quad((x1, half, z0), (0, -thick, 0), dz, edge))
        model.quads.append(place.quad((x0, half, z1), dx, (0, -thick, 0), edge))
        if z0 > 0:
            model.quads.append(place.quad((x0, -half, z0), dx, dy, edge))
    if s.flag("free", False):
        model.quads.append(place.quad((0, half, 0), (0, -thick, 0), (0, 0, height), edge))
        model.quads.append(place.quad((length, -half, 0), (0, thick, 0), (0, 0, height), edge))
        model.quads.append(place.quad((0, -half, height), (length, 0, 0), (0, thick, 0), edge))


def _holes(s: Section, length: float, height: float) -> list[tuple[float, float, float, float]]:
    """(x0, x1, z0, z1) of each opening, from one end of the wall to the other."""
    holes = []
    for opening in s.sections("openings", "opening"):
        middle, width = opening.number("at"), opening.number("width", 0.9, 0.01, 1000)
        bottom = opening.number("bottom", 0.0, 0, height)
        hole = (middle - width / 2, middle + width / 2, bottom, bottom + opening.number("height", 2.0, 0.01, 1000))
        opening.done()
        if hole[0] < 0 or hole[1] > length or hole[3] > height:
            raise opening.wrong(f"reaches beyond its wall of {length:.2f} x {height:g} m; make it smaller or move it")
        holes.append(hole)
    holes.sort()
    if any(one[1] > other[0] for one, other in pairwise(holes)):
        raise s.wrong("has openings that overlap; move one, or make them one")
    return holes


def _pieces(
    holes: list[tuple[float, float, float, float]], length: float, height: float
) -> Iterator[tuple[float, float, float, float]]:
    """(x0, x1, z0, z1) of what the openings leave of a wall: between, above and below them."""
    edges = [0.0, *(x for hole in holes for x in hole[:2]), length]
    yield from ((x0, x1, 0.0, height) for x0, x1 in zip(edges[::2], edges[1::2], strict=True) if x1 > x0)
    yield from ((x0, x1, z1, height) for x0, x1, _, z1 in holes if z1 < height)
    yield from ((x0, x1, 0.0, z0) for x0, x1, z0, _ in holes if z0 > 0)


def door(s: Section, model: Model) -> None:
    """A door's leaf on its hinge `at` (x, y): closed, it lies along +x, rotated by `turn_deg`; `open_deg` opens it further."""
    closed, (width, height) = place_of(s), s.size("size", 2, [0.9, 2.0])
    leaf = Place(closed.at, closed.turn_rad + np.deg2rad(s.number("open_deg", 0.0, -180, 180)))
    half = s.number("thickness", 0.04, 0.005, 1) / 2
    # a little smaller than its opening, so that it shares no plane with the frame
    low, high = (0.005, -half, 0.005), (width - 0.005, half, height - 0.005)
    model.box(leaf, low, high, paint_of(s, "texture", model.paints))
    model.solid(name_of(s), leaf, low, high)


def cylinder(s: Section, model: Model) -> None:
    """A column, pot, bin or round table: `at`, `size` (diameter, height), an even number of `sides`; a `top`."""
    place, (diameter, height) = place_of(s), s.size("size", 2)
    sides = int(s.number("sides", 10, 4, 64))
    if sides % 2:
        raise s.invalid("sides", sides, "an even number from 4 to 64: each side has one opposite")
    paint = paint_of(s, "texture", model.paints)
    _prism(model, place, diameter, height, sides, paint, paint_of(s, "top", model.paints) if "top" in s else paint)
    r = diameter / 2
    model.solid(name_of(s), place, (-r, -r, 0), (r, r, height))


def _prism(model: Model, place: Place, diameter: float, height: float, sides: int, paint: Paint, top: Paint) -> None:
    """Upright, on the plane of `place`; a regular polygon of that diameter across its corners."""
    angle = 2 * np.pi * np.arange(sides // 2) / sides
    edge = diameter * np.sin(np.pi / sides)
    around = edge * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    middle = Place(np.add(place.at, [0, 0, height / 2]), place.turn_rad)
    before = len(model.quads)
    model.zonohedron(middle, [*around, (0, 0, height)], paint, top)
    if place.at[2] == 0:  # it stands on the floor, and hides its lower end
        model.quads[before:] = [f for f in model.quads[before:] if (f.corner + f.u + f.v)[2] > height / 2]


def building(s: Section, model: Model) -> None:
    """A house: `at`, `size`, a `texture` on its four sides (its front, at -y, may differ) and a `roof`."""
    place, size = place_of(s), np.array(s.size("size", 3))
    low, high = size * [-0.5, -0.5, 0], size * [0.5, 0.5, 1]
    paint = paint_of(s, "texture", model.paints)
    front = paint_of(s, "front", model.paints) if "front" in s else paint
    model.box(place, low, high, paint, front, paint_of(s, "roof", model.paints))
    model.quads.pop()  # what it stands on is never seen
    model.solid(name_of(s), place, low, high)


def tree(s: Section, model: Model) -> None:
    """A trunk and a crown of 20 rhombi: `at`, `size` (width of the crown, height), `texture` of its leaves, `bark`."""
    place, (width, height) = place_of(s), s.size("size", 2)
    bare = s.number("trunk_m", 0.35 * height, 0.01, height)
    leaves, bark = paint_of(s, "texture", model.paints), paint_of(s, "bark", model.paints, (95, 75, 60))
    before = len(model.quads)
    _prism(model, place, 0.1 * width, bare + 0.2 * (height - bare), 6, bark, bark)
    model.quads[before:] = [quad for quad in model.quads[before:] if quad.u[2] or quad.v[2]]  # the crown hides its top
    reach = np.abs(CROWN).sum(axis=0)
    crown = Place(np.add(place.at, [0, 0, (bare + height) / 2]), place.turn_rad)
    model.zonohedron(crown, CROWN / reach * [width, width, height - bare], leaves)
    model.solid(f"trunk of {name_of(s)}", place, (-0.05 * width, -0.05 * width, 0), (0.05 * width, 0.05 * width, bare))
    r = width / 2 * 0.85  # the crown fills its box up to the corners
    model.solid(name_of(s), place, (-r, -r, bare), (r, r, height))
