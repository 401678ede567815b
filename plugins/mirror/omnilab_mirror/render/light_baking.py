"""Light baking: the quads' pictures with light and shadows painted in, so that light costs nothing when rays are traced."""

from __future__ import annotations

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_mirror.render.shadows import lamplight
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.quads import Quad
from omnilab_mirror.scene.textures.canvas import Canvas
from omnilab_mirror.scene.world import World

LATTICE_TEXELS = 5  # light is computed on a lattice this wide, and interpolated


def bake_pictures(world: World) -> list[Bytes]:
    """The picture (h, w, 3) of each quad as lit; row 0 is at its corner and edge u."""
    lattices = brightness_of(world.light, world.quads, LATTICE_TEXELS / world.texels_per_m)
    return [_picture(world, quad, lattice) for quad, lattice in zip(world.quads, lattices, strict=True)]


def brightness_of(light: Illumination, quads: list[Quad], spacing_m: float) -> list[Floats]:
    """Brightness (rows, columns) of each quad on a lattice about `spacing_m` wide, its nodes in its cells' middles.

    The ambient light, and of each lamp what Lambert's cosine law and the quads in between let through.
    """
    points = [lamp.points(light.shadows) for lamp in light.lamps]
    lamps = np.array(
        [
            (*point, lamp.power / len(around), lamp.reach_m)
            for lamp, around in zip(light.lamps, points, strict=True)
            for point in around
        ]
    ).reshape(-1, 5)
    first = np.cumsum([0, *map(len, points)])
    return [light.ambient + lattice for lattice in lamplight(quads, lamps, first, spacing_m, light.shadows)]


def _picture(world: World, quad: Quad, lattice: Floats) -> Bytes:
    width, height = float(np.linalg.norm(quad.u)), float(np.linalg.norm(quad.v))
    shape = (max(2, round(height * world.texels_per_m)), max(2, round(width * world.texels_per_m)))
    canvas = Canvas((width, height), shape, np.random.default_rng([world.seed, *quad.seed]))
    picture = quad.paint.painter(canvas)
    if not quad.paint.glows:
        picture = picture * cv2.resize(lattice, shape[::-1], interpolation=cv2.INTER_LINEAR)[..., None]
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)
