"""Requests for poses, and the plan that a sensor answers them with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from omnilab.api.data import Floats


@dataclass(frozen=True)
class GridPoses:
    """A regular grid of positions, heading 0 (a recording: as it was). Give `step_m`, or `every` n-th row and column of a recording."""

    step_m: float | None = None
    every: int | None = None
    extent_m: tuple[float, float] | None = None  # x and y, around the world's origin; None: all the sensor covers
    height_m: float | None = None  # of the viewpoint above the floor; None: the sensor's own


@dataclass(frozen=True)
class RandomPoses:
    """`count` positions drawn uniformly, with headings drawn uniformly or from the multiples of `heading_step_rad`."""

    count: int
    seed: int
    heading_step_rad: float | None = None  # None: any heading
    extent_m: tuple[float, float] | None = None
    height_m: float | None = None


@dataclass(frozen=True)
class PathPoses:
    """Given poses in a given order: `T_world_camera` (N, 4, 4)."""

    T_world_camera: Floats


@dataclass(frozen=True)
class NamedPath:
    """A path that the sensor's world knows by name, in its order."""

    name: str
    height_m: float | None = None


@dataclass(frozen=True)
class RecordedPoses:
    """All that was recorded, less what another layout takes of it."""

    without: GridPoses | None = None


PoseRequest = GridPoses | RandomPoses | PathPoses | NamedPath | RecordedPoses


@dataclass(frozen=True)
class Plan:
    """What a sensor will deliver for a layout: N frames in this order. No image is made or read yet."""

    keys: Sequence[str]  # (N,) what names each image's content: file, or digest of world, camera and pose
    T_world_camera: Floats | None  # (N, 4, 4) float64, None where the recording has no positions
    omitted: Sequence[str] = ()  # one entry per pose or file left out, with its reason
    first: int = 0  # of the part of a plan: which frame of the whole its first is

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, indices: Iterable[int]) -> Plan:
        """The same plan, reduced to some of its frames, in the order given."""
        chosen = [int(i) for i in indices]
        poses = None if self.T_world_camera is None else self.T_world_camera[chosen]
        return Plan([self.keys[i] for i in chosen], poses)

    def part(self, first: int, last: int) -> Plan:
        """The frames from `first` up to `last`, which the sensor's clock counts as frames of the whole."""
        poses = None if self.T_world_camera is None else self.T_world_camera[first:last]
        return Plan(self.keys[first:last], poses, first=self.first + first)
