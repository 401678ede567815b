"""Paths of a world file: polylines on the floor, along which a robot takes images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab.geometry import planar_poses
from omnilab_mirror.scene.world_yaml import Section


@dataclass(frozen=True)
class Route:
    """Corners (n, 2), the spacing of images, and whether it ends where it begins.

    Around a corner the robot turns from `turn_m` before it to `turn_m` behind it.
    """

    points: Floats
    step_m: float
    closed: bool
    turn_m: float

    @property
    def length_m(self) -> float:
        return float(self._along[-1])

    @property
    def corners(self) -> Floats:
        return np.concatenate([self.points, self.points[:1]]) if self.closed else self.points

    @property
    def _along(self) -> Floats:
        return np.cumsum([0, *np.linalg.norm(np.diff(self.corners, axis=0), axis=1)])

    def at(self, distance_m: Floats) -> Floats:
        """Points (N, 2) at distances (N,) from the start; past the ends of an open route, straight on."""
        along, corners = self._along, self.corners
        distance = np.mod(distance_m, along[-1]) if self.closed else np.asarray(distance_m)
        leg = np.clip(np.searchsorted(along, distance, side="right") - 1, 0, len(along) - 2)
        share = (distance - along[leg]) / np.diff(along)[leg]
        return np.asarray(corners[leg] + share[:, None] * np.diff(corners, axis=0)[leg])

    def poses(self, height_m: float) -> Floats:
        """`T_world_camera` (N, 4, 4), evenly spaced by about `step_m`, headed along the motion.

        Open routes have an image at both ends; closed ones do not repeat their first.
        """
        steps = max(1, round(self.length_m / self.step_m))
        distance = np.arange(steps + (not self.closed)) * (self.length_m / steps)
        ahead, behind = self.at(distance + self.turn_m), self.at(distance - self.turn_m)
        # the difference vanishes where the route turns back on itself
        motion = np.where(_long(ahead - behind), ahead - behind, ahead - self.at(distance))
        position = np.column_stack([self.at(distance), np.full(len(distance), height_m)])
        return planar_poses(position, np.arctan2(motion[:, 1], motion[:, 0]))


def _long(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True) > 1e-6)


def route(s: Section) -> Route:
    """The route that a section of `paths` describes."""
    points = np.array(s.points("points", 2), float).reshape(-1, 2)
    if len(points) < 2 or not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
        raise s.invalid("points", points.tolist(), "at least 2 points, no two the same in a row")
    closed = s.flag("closed", False)
    if closed and np.array_equal(points[0], points[-1]):
        raise s.invalid("points", points.tolist(), "a closed path without its first point at the end; remove it")
    result = Route(points, s.number("step_m", low=0.001, high=1000), closed, s.number("turn_m", 0.25, 1e-6, 100))
    s.done()
    return result
