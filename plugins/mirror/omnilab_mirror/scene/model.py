"""A world while its objects are being placed: what they add their quads, boxes and meshes to."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Floats
from omnilab_mirror.scene.quads import Area, Place, Quad, Solid
from omnilab_mirror.scene.textures.canvas import Paint
from omnilab_mirror.scene.world_yaml import Section

if TYPE_CHECKING:
    from omnilab_mirror.scene.meshes.mesh_file import MeshFile


@dataclass
class Model:
    """A world while its objects are being placed in it."""

    paints: dict[str, Paint]
    quads: list[Quad] = field(default_factory=list)
    solids: list[Solid] = field(default_factory=list)
    areas: list[Area] = field(default_factory=list)
    room: Floats | None = None  # (2, 3): lowest and highest corner of the one that panels hang in
    meshes: list[MeshFile] = field(default_factory=list)  # where they stand
    files: dict[tuple[Path, str | None], MeshFile] = field(default_factory=dict)  # as they are, by their up axis, too

    def box(
        self, place: Place, low: Any, high: Any, paint: Paint, front: Paint | None = None, top: Paint | None = None
    ) -> None:
        """Six quads from `low` to `high` (3,) in the frame of `place`; its front looks to -y."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
        self.quads += [
            place.quad((x0, y0, z0), (dx, 0, 0), (0, 0, dz), front or paint),
            place.quad((x1, y1, z0), (-dx, 0, 0), (0, 0, dz), paint),
            place.quad((x0, y1, z0), (0, -dy, 0), (0, 0, dz), paint),
            place.quad((x1, y0, z0), (0, dy, 0), (0, 0, dz), paint),
            place.quad((x0, y0, z1), (dx, 0, 0), (0, dy, 0), top or paint),
            place.quad((x0, y1, z0), (dx, 0, 0), (0, -dy, 0), paint),
        ]

    def zonohedron(self, place: Place, generators: Any, paint: Paint, ends: Paint | None = None) -> None:
        """The sum of segments (n, 3) around the origin of `place`, as parallelograms (Fedorov): a prism, a crown.

        `ends`: what covers the level quads. The quads in one plane tile it as the lower hull of its lifted segments does.
        """
        g = np.asarray(generators, float)
        lifted = g + np.outer(np.arange(len(g)) ** 2, [0, 0, 1e-7 * np.abs(g).max()])
        for i, j in combinations(range(len(g)), 2):
            others = [k for k in range(len(g)) if k not in {i, j}]
            outer = np.sign(lifted[others] @ np.cross(lifted[i], lifted[j])) @ g[others] / 2
            level = np.hypot(*np.cross(g[i], g[j])[:2]) < 1e-9
            for corner, u, v in ((outer, g[i], g[j]), (-outer, g[j], g[i])):
                self.quads.append(place.quad(corner - (u + v) / 2, u, v, (ends or paint) if level else paint))

    def solid(self, name: str, place: Place, low: Any, high: Any) -> None:
        """Keep viewpoints out of a box."""
        self.solids.append(Solid(name, place, np.asarray(low, float), np.asarray(high, float)))


def place_of(s: Section) -> Place:
    """Where an object stands: `at` (x, y), `z` of its bottom, `turn_deg`."""
    x, y = s.numbers("at", 2)
    return Place(np.array([x, y, s.number("z", 0.0)]), np.deg2rad(s.number("turn_deg", 0.0)))


def name_of(s: Section) -> str:
    """What an object is called: its `name`, or else its `kind`."""
    return s.word("name", s.value("kind"))
