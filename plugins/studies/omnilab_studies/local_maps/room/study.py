"""Study D: local maps in one room, virtual or recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from omnilab.api import GridPoses, Parts, Plan, RecordedPoses, setting
from omnilab.errors import ConfigError
from omnilab.metrics import spacing
from omnilab_studies.common.free_area import free_square, poses_with_headings, positions_within
from omnilab_studies.common.pose_sources import changed
from omnilab_studies.common.scores import known_poses
from omnilab_studies.local_maps.local_map.study import LocalMap


@dataclass
class Room(LocalMap):
    """Study D: a few queries, many starts, in one small map (Berenguer, thesis, 4.6.4, figures 4.19 and 4.20).

    Virtual: `side` x `side` places on the free square nearest to `center_m`, queries within it. Recorded, with `every`:
    each n-th row and column are places, and the queries are the other images, or those that the sensor has with the
    settings `tests` (`+study.tests.path=DIR`). Errors, methods and localizers are those of the study `local_map`; disturbances
    spoil the queries, so that a sweep over occlusion compares with and without.
    """

    steps_m: list[float] = setting([0.2], above=0, fewest=1)  # of a virtual map
    neighbours: list[int] = setting([9], at_least=3, at_most=10_000, fewest=1)  # places in a map
    query_count: int = setting(13, at_least=1, at_most=1_000_000)  # within the map
    starts: int = setting(
        50, at_least=1, at_most=10_000
    )  # maps of each query, each from a start of its own and scored apart
    side: int = setting(8, at_least=2, at_most=1000)  # places along x and along y
    center_m: list[float] = setting([0.0, 0.0], count=2)  # the map is the free square nearest to it
    every: int | None = setting(None, at_least=1)  # 1: all that was recorded; null: virtual
    tests: dict[str, Any] = setting({})  # settings of the sensor of recorded queries; none: the rest

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.every is None and (self.tests or len(self.steps_m) > 1):
            raise ConfigError(
                f"study.tests={self.tests}, study.steps_m={self.steps_m}: a virtual room takes no tests and one step; give"
                " study.every for a recording"
            )

    def _grids(self, parts: Parts) -> dict[float, Plan]:
        if self.every is None:
            grid = free_square(parts.sensor, self.side, self.steps_m[0], self.center_m, self.height_m)
        else:
            grid = parts.sensor.plan(GridPoses(every=self.every))
        step_m = round(spacing(known_poses(grid.T_world_camera, "places")[:, :3, 3]), 3)
        self._check_neighbours(step_m, len(grid))
        return {step_m: grid}

    def _queries(self, parts: Parts, grids: Mapping[float, Plan], rng: np.random.Generator) -> tuple[Parts, Plan]:
        if self.every is None:
            (grid,) = grids.values()
            at = positions_within(grid, self.query_count, rng)
            return parts, parts.sensor.plan(poses_with_headings(at, rng.random(self.query_count)))
        if self.every == 1 and not self.tests:
            raise ConfigError(
                "study.every=1 makes every image a place and leaves no queries; give +study.tests.path=DIR, or study.every=2"
            )
        without = None if self.tests else GridPoses(every=self.every)
        query_parts = replace(parts, sensor=changed(parts.sensor, "study.tests", self.tests))
        plan = query_parts.sensor.plan(RecordedPoses(without=without))
        chosen = rng.choice(len(plan), min(self.query_count, len(plan)), replace=False)
        return query_parts, plan.at(np.sort(chosen))
