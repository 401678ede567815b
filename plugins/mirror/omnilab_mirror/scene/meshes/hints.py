"""Hints about a mesh's unit and up axis: questions with both readings, asked only where the given reading is unlikely."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from omnilab.api import Floats
from omnilab_mirror.scene.meshes.triangles import Triangles
from omnilab_mirror.scene.quads import Area

SETTING = "sensor.{}={}"  # how a setting of a mesh file that is a world is written
ENTRY = "{}: {}"  # and that of one among the objects of a world file
UNITS = {"centimetres": 0.01, "inches": 0.0254, "millimetres": 0.001}
TALLEST_M = 50.0  # what is higher is asked about
HIGHEST_ROOM_M = 30.0  # of a world file
SMALLEST_M = 1.0  # and, where it is all of the world, what is smaller
ROOM_M = 2.7  # a storey
STOREY_M = 3.5  # nothing is asked about the axis of what is as low as this: it may well stand
NARROWEST_M = 1.5  # nor of what is narrower than a corridor: a column, a shelf
FLOOR = 0.7  # of the level area that what would be floors and ceilings must have: they are as much in a room without a ceiling


def hints(triangles: Triangles, up: str, scale: float, written: str = SETTING) -> Iterator[str]:
    """Questions about triangles in metres, z up, that were read with the file's axis `up` and `scale` metres a unit."""
    low, high = triangles.bounds
    extent = high - low
    if extent[2] > TALLEST_M:
        unit = likely_unit(extent / scale)
        other = extent / scale * UNITS[unit]
        yield (
            f"it is {size_of(extent)} with scale={scale:g}; if it is in {unit}, {size_of(other)}, set"
            f" {written.format('scale', UNITS[unit])}"
        )
    elif extent.max() < SMALLEST_M and written == SETTING:
        yield (
            f"it is only {size_of(extent)} with scale={scale:g}; if that is too small, set"
            f" {written.format('scale', f'{100 * scale:g}')} or the like"
        )
    if lies_on_its_side(triangles):
        other_up = "z" if up == "y" else "y"
        yield (
            f"it may lie on its side: with up={up} it is {size_of(extent)}, which is more than it is deep; if it should be"
            f" {size_of(extent[[0, 2, 1]])}, set {written.format('up', other_up)}"
        )


def unit_of_areas(areas: Sequence[Area]) -> str:
    """A question about rooms that are higher than any; "" where there are none."""
    for area in areas:
        extent = area.high - area.low
        if area.walled and extent[2] > HIGHEST_ROOM_M:
            unit = likely_unit(extent)
            return (
                f"'{area.name}' is {size_of(extent)}, and lengths are in metres; if these are in {unit}, divide all"
                f" lengths of the file by {1 / UNITS[unit]:.4g}"
            )
    return ""


def size_of(extent: Floats) -> str:
    """'6 x 5 m and 2.8 m high' of an extent (3,)."""
    x, y, z = (f"{side:.4g}" if side < 1000 else f"{side:.0f}" for side in extent)
    return f"{x} x {y} m and {z} m high"


def likely_unit(extent: Floats) -> str:
    """The unit that makes a room of something of this extent (3,) in its unit."""
    height = extent[2] or extent.max() / 3
    return min(UNITS, key=lambda unit: abs(float(np.log(height * UNITS[unit] / ROOM_M))))


def lies_on_its_side(triangles: Triangles) -> bool:
    """Whether y, rather than z, looks like the vertical: taller than deep, and with area for floors across y."""
    low, high = triangles.bounds
    width, depth, height = high - low
    area = triangles.twice_areas
    level_y, level_z = (area[np.abs(triangles.normals[:, axis]) > 0.95 * area].sum() for axis in (1, 2))
    return bool(height > max(STOREY_M, depth) and width > NARROWEST_M and level_y > FLOOR * level_z)
