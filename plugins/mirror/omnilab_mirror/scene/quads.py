"""Parallelograms, the upright frames they are placed in, and the boxes that bound viewpoints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats
from omnilab_mirror.scene.textures.canvas import Paint


@dataclass(frozen=True)
class Quad:
    """A parallelogram: corner (3,) and edges u, v (3,) in metres. Its front, that lamps shine on, is where u x v points."""

    corner: Floats
    u: Floats
    v: Floats
    paint: Paint
    overhead: bool = False  # left out of a view from above
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
    """An upright frame at (x, y, z), rotated about +z."""

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

    def quad(self, corner: Any, u: Any, v: Any, paint: Paint) -> Quad:
        """A quad given in this frame."""
        R = self.rotation
        return Quad(self.at + R @ np.asarray(corner, float), R @ np.asarray(u, float), R @ np.asarray(v, float), paint)
