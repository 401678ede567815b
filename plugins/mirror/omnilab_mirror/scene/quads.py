"""Parallelograms, and the boxes and solids made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats
from omnilab_mirror.scene.textures.canvas import Paint
from omnilab_mirror.scene.world_yaml import Section

if TYPE_CHECKING:
    from omnilab_mirror.scene.meshes.mesh_file import MeshFile

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Face:
    """A parallelogram: corner (3,) and edges u, v (3,) in metres. Its front, that lamps shine on, is where u x v points."""

    corner: Floats
    u: Floats
    v: Floats
    paint: Paint
    overhead: bool = False  # left out where one looks in from above
    name: str = ""  # of its object
    seed: tuple[int, int] = (0, 0)  # number of its object in the file, and its own in the object


@dataclass(frozen=True)
class Solid:
    """What no viewpoint may lie in: a box between `low` and `high` (3,) in the frame of `place`."""

    name: str
    place: Place
    low: Floats
    high: Floats

    def holds(self, points: Floats, clearance_m: float) -> Bools:
        """Which of the points (N, 3) lie inside or nearer than the clearance."""
        lower = self.place.local(points)[:, 2] < self.high[2] + clearance_m
        return np.asarray(self.is_below(points, clearance_m) & lower)

    def is_below(self, points: Floats, clearance_m: float) -> Bools:
        """Which of the points (N, 3) lie inside or straight above: where a robot on the floor would stand in it."""
        local, low, high = self.place.local(points), self.low - clearance_m, self.high + clearance_m
        over = np.all((local[:, :2] > low[:2]) & (local[:, :2] < high[:2]), axis=1)
        return np.asarray(over & (local[:, 2] > low[2]))


@dataclass(frozen=True)
class Area:
    """Where viewpoints may be: a box between `low` and `high` (3,), with walls around it or open at its sides."""

    name: str
    low: Floats
    high: Floats
    walled: bool

    def holds(self, points: Floats, clearance_m: float) -> Bools:
        """Which of the points (N, 3) lie inside, and no nearer to floor, ceiling and walls than the clearance."""
        margin = np.array([clearance_m * self.walled, clearance_m * self.walled, clearance_m])
        return np.asarray(np.all((points >= self.low + margin) & (points <= self.high - margin), axis=1))


@dataclass(frozen=True)
class Place:
    """An upright frame at (x, y, z), turned about +z."""

    at: Floats
    turn_rad: float

    @property
    def rotation(self) -> Floats:
        """From this frame's directions to the world's, (3, 3)."""
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

    def local(self, points: Floats) -> Floats:
        """World points (N, 3) in this frame."""
        return (points - self.at) @ self.rotation

    def face(self, corner: Any, u: Any, v: Any, paint: Paint) -> Face:
        """A face given in this frame."""
        R = self.rotation
        return Face(self.at + R @ np.asarray(corner, float), R @ np.asarray(u, float), R @ np.asarray(v, float), paint)


@dataclass
class Model:
    """A world while its objects are being placed in it."""

    paints: dict[str, Paint]
    faces: list[Face] = field(default_factory=list)
    solids: list[Solid] = field(default_factory=list)
    areas: list[Area] = field(default_factory=list)
    room: Floats | None = None  # (2, 3): lowest and highest corner of the one that panels hang in
    meshes: list[MeshFile] = field(default_factory=list)  # where they stand

    def box(
        self, place: Place, low: Any, high: Any, paint: Paint, front: Paint | None = None, top: Paint | None = None
    ) -> None:
        """Six faces from `low` to `high` (3,) in the frame of `place`; its front looks to -y."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
        self.faces += [
            place.face((x0, y0, z0), (dx, 0, 0), (0, 0, dz), front or paint),
            place.face((x1, y1, z0), (-dx, 0, 0), (0, 0, dz), paint),
            place.face((x0, y1, z0), (0, -dy, 0), (0, 0, dz), paint),
            place.face((x1, y0, z0), (0, dy, 0), (0, 0, dz), paint),
            place.face((x0, y0, z1), (dx, 0, 0), (0, dy, 0), top or paint),
            place.face((x0, y1, z0), (dx, 0, 0), (0, -dy, 0), paint),
        ]

    def zonohedron(self, place: Place, generators: Any, paint: Paint, ends: Paint | None = None) -> None:
        """The sum of segments (n, 3) around the origin of `place`, as parallelograms (Fedorov): a prism, a crown.

        `ends`: what covers the level faces. The faces in one plane tile it as the lower hull of its lifted segments does.
        """
        g = np.asarray(generators, float)
        lifted = g + np.outer(np.arange(len(g)) ** 2, [0, 0, 1e-7 * np.abs(g).max()])
        for i, j in combinations(range(len(g)), 2):
            others = [k for k in range(len(g)) if k not in {i, j}]
            outer = np.sign(lifted[others] @ np.cross(lifted[i], lifted[j])) @ g[others] / 2
            level = np.hypot(*np.cross(g[i], g[j])[:2]) < 1e-9
            for corner, u, v in ((outer, g[i], g[j]), (-outer, g[j], g[i])):
                self.faces.append(place.face(corner - (u + v) / 2, u, v, (ends or paint) if level else paint))

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
