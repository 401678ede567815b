"""Columns of images above one position, and their reference images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Floats, Ints, PathPoses, Plan, RandomPoses, Sensor
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.limits import check_work
from omnilab_studies.common.scores import known_poses

POSE_BYTES = 150  # of a pose (4, 4), and of its position
TOGETHER_M = 0.05  # positions that are one column, and heights that are the same


@dataclass(frozen=True)
class Column:
    """n images above one position, from the lowest to the highest."""

    position_m: Floats  # (2,)
    height_m: Floats  # (n,)
    index: Ints  # (n,) in the plan

    def __str__(self) -> str:
        heights = ", ".join(f"{height:g}" for height in self.height_m.round(3))
        return f"the column at ({self.position_m[0]:.2f}, {self.position_m[1]:.2f}) m with heights {heights} m"


@dataclass(frozen=True)
class Reference:
    """Which image of every column the others are compared with: the one at a height, or the `number`-th from below."""

    height_m: float = 0.0
    number: int | None = None

    def __str__(self) -> str:
        return f"{self.height_m:g} m" if self.number is None else f"h={self.number}"

    def is_in(self, column: Column) -> bool:
        """Whether a column has such an image."""
        row = self.row(column)
        return row < len(column.index) and (
            self.number is not None or abs(column.height_m[row] - self.height_m) < TOGETHER_M
        )

    def row(self, column: Column) -> int:
        """Its index in a column that has it."""
        return int(np.abs(column.height_m - self.height_m).argmin()) if self.number is None else self.number - 1


def free_columns(
    sensor: Sensor, count: int, positions_m: Sequence[Sequence[float]] | None, heights_m: Sequence[float],
    random_headings: bool, rng: np.random.Generator,
) -> Plan:  # fmt: skip
    """Columns over given positions, or over `count` random ones that are free up to the highest of [low, high, step]."""
    if positions_m is None:
        free = sensor.plan(RandomPoses(count, int(rng.integers(2**32)), height_m=heights_m[1]))
        positions_m = known_poses(free.T_world_camera, "columns")[:, :2, 3].tolist()
    at = column_poses(positions_m, heights_m)[:, :3, 3]
    heading = rng.uniform(0, 2 * np.pi, len(at)) if random_headings else 0.0
    return sensor.plan(PathPoses(planar_poses(at, heading)))


def columns_in(plan: Plan) -> list[Column]:
    """The columns of a plan; DataError if its images have no heights, or only one each."""
    if plan.T_world_camera is None:
        raise DataError(
            f"the {len(plan)} images have no heights; name them as sensor.names=umh_altitude has it,"
            " or write a positions.csv with x_m, y_m, z_m"
        )
    at = plan.T_world_camera[:, :3, 3]
    left = np.arange(len(at))
    found = []
    while len(left):
        beside = np.abs(at[left, :2] - at[left[0], :2]).max(axis=1) < TOGETHER_M
        of = left[beside]
        of = of[np.argsort(at[of, 2], kind="stable")]
        found.append(Column(at[of[0], :2], at[of, 2], of))
        left = left[~beside]
    tall = [c for c in found if np.ptp(c.height_m) >= TOGETHER_M]
    if not tall:
        first = found[0]
        problem = "is one image" if len(first.index) == 1 else f"has {len(first.index)} images of one height"
        raise DataError(f"{first} {problem}, and no other has more; give images of one spot at two heights or more")
    return tall


def column_poses(positions_m: Sequence[Sequence[float]], heights_m: Sequence[float]) -> Floats:
    """`T_world_camera` (N, 4, 4) over each floor position (x, y), from the lowest of [low, high, step] to the highest."""
    low, high, step = heights_m
    count = len(positions_m) * ((high - low) / step + 1)
    what = f"the {count:.3g} poses of {len(positions_m)} columns with heights_m={list(heights_m)}"
    check_work(what, "give a larger step of the heights", memory=POSE_BYTES * count)
    heights = low + step * np.arange(int((high - low) / step + 1e-6) + 1)
    return planar_poses(np.array([(x, y, z) for x, y in positions_m for z in heights]))


def check_positions(positions_m: Sequence[Any] | None) -> None:
    """ConfigError unless floor positions are one or more [x, y], or null."""
    if positions_m is not None and not (positions_m and all(map(_is_position, positions_m))):
        raise ConfigError(f"study.positions_m={positions_m} are no positions; give [[x, y], ...] in metres")


def check_heights(heights_m: Sequence[float]) -> None:
    """ConfigError unless heights are a range [lowest, highest, step]."""
    if not _is_range(heights_m):
        raise ConfigError(f"study.heights_m={heights_m} is no range; give [lowest, highest, step] in metres")


def _is_position(value: Any) -> bool:
    """Whether a value is two finite numbers: OmegaConf takes integers for no floats, so the field's type cannot check it."""
    numbers = isinstance(value, list) and len(value) == 2 and all(type(v) in {int, float} for v in value)
    return numbers and all(map(math.isfinite, value))


def _is_range(values: Sequence[float]) -> bool:
    return len(values) == 3 and all(map(math.isfinite, values)) and values[0] <= values[1] and values[2] > 0
