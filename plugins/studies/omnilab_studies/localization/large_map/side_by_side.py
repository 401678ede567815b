"""Several virtual worlds side by side, as one sensor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from omnilab.api import Floats, Frames, Mesh, Places, Plan, PoseRequest, RandomPoses, Sensor
from omnilab.errors import ConfigError
from omnilab_studies.common.scores import known_poses

GAP_M = 2.0  # between two worlds


@dataclass
class SideBySide:
    """Sensors in worlds of their own, moved apart along x; poses are in the first one's world frame.

    Random poses are shared out evenly.
    """

    sensors: Sequence[Sensor]
    shift_m: Floats  # (N,) how far each sensor's world was moved along x
    end_m: Floats  # (N,) where it ends, in x

    @classmethod
    def of(cls, sensors: Sequence[Sensor], layout: PoseRequest) -> SideBySide:
        """The worlds moved apart by the extent of the requested poses and of the scene in each."""
        shifts: list[float] = []
        ends: list[float] = []
        for sensor in sensors:
            left, right = _width(sensor, layout)
            shifts.append(ends[-1] + GAP_M / 2 - left if ends else 0.0)
            ends.append(right + shifts[-1] + GAP_M / 2)
        return cls(sensors, np.array(shifts), np.array(ends))

    def first(self, count: int) -> SideBySide:
        """The first worlds alone, where they are."""
        return SideBySide(self.sensors[:count], self.shift_m[:count], self.end_m[:count])

    def part_of(self, places: Places) -> Places:
        """Those places of a larger map, world after world, that lie in these worlds."""
        T = known_poses(places.T_world_camera, "places")
        count = int((T[:, 0, 3] < self.end_m[-1]).sum())
        return Places(places.signatures[:count], T[:count], places.keys[:count])

    def plan(self, layout: PoseRequest) -> Plan:
        """The requested poses in every world, one world after the other."""
        plans = [sensor.plan(own) for sensor, own in zip(self.sensors, self._shared(layout), strict=True)]
        poses = [
            _moved(known_poses(plan.T_world_camera, "images"), shift)
            for plan, shift in zip(plans, self.shift_m, strict=True)
        ]
        omitted = [sentence for plan in plans for sentence in plan.omitted]
        return Plan([key for plan in plans for key in plan.keys], np.concatenate(poses), omitted)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The images, world by world."""
        T = known_poses(plan.T_world_camera, "images")
        world = np.searchsorted(self.end_m, T[:, 0, 3])
        for i, (sensor, shift) in enumerate(zip(self.sensors, self.shift_m, strict=True)):
            here = np.flatnonzero(world == i)
            own = Plan(plan.at(here).keys, _moved(T[here], -shift))
            for frames in sensor.frames(own):
                index = here[frames.plan_index]
                yield replace(frames, plan_index=index, T_world_camera=T[index])

    def scene(self) -> Mesh | None:
        """The worlds that are known, as one mesh."""
        meshes = [(mesh, dx) for s, dx in zip(self.sensors, self.shift_m, strict=True) if (mesh := s.scene())]
        if not meshes:
            return None
        first = np.cumsum([0, *(len(mesh.vertices_m) for mesh, _ in meshes)])
        return Mesh(
            np.concatenate([mesh.vertices_m + np.array([dx, 0, 0]) for mesh, dx in meshes]),
            np.concatenate([mesh.triangles + n for (mesh, _), n in zip(meshes, first, strict=False)]),
            np.concatenate([mesh.colors for mesh, _ in meshes]),
        )

    def _shared(self, layout: PoseRequest) -> list[PoseRequest]:
        if not isinstance(layout, RandomPoses):
            return [layout] * len(self.sensors)
        ends = np.linspace(0, layout.count, len(self.sensors) + 1).astype(int)
        return [replace(layout, count=int(count)) for count in np.diff(ends)]


def _width(sensor: Sensor, layout: PoseRequest) -> tuple[float, float]:
    """The least and the greatest x of the requested poses, and of the world around them."""
    x = known_poses(sensor.plan(layout).T_world_camera, "places")[:, 0, 3]
    if mesh := sensor.scene():
        x = np.append(x, mesh.vertices_m[:, 0])
    return float(x.min()), float(x.max())


def _moved(T: Floats, shift_m: float) -> Floats:
    moved = T.copy()
    moved[:, 0, 3] += shift_m
    return moved


def in_worlds(sensor: Any, worlds: Sequence[str]) -> list[Sensor]:
    """The sensor, and the same in each of other worlds."""
    if worlds and not (is_dataclass(sensor) and "world" in {f.name for f in fields(sensor)}):
        raise ConfigError(
            f"study.worlds={list(worlds)} need a virtual sensor, and {type(sensor).__name__} images the world it has;"
            " leave study.worlds empty"
        )
    return [sensor, *(replace(sensor, world=world) for world in worlds)]
