"""A map, described once and kept for other runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import (
    Metric,
    NamedPath,
    Parts,
    PlaceMap,
    Places,
    Plan,
    PoseRequest,
    RecordedPoses,
    Recorder,
    Report,
    Text,
    Tick,
)
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of
from omnilab.metrics import spacing
from omnilab_studies.common.describing import deliver, describe_places, evenly, fitted, markdown_table, show_frame
from omnilab_studies.common.grids import check_extent, check_step_or_every, grid_poses
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.localization.map.layout import LAYOUT


@dataclass
class MakeMap:
    """Describe the places of a grid, of a path or of a recording, and keep them as `map.npz` in the run's folder.

    Other runs localise in it: `omnilab experiment=localize map=FILE`. It holds signatures, poses and what a descriptor
    has learnt, and the settings of descriptor and distance; no pictures.
    """

    places: Source = Source.grid  # grid, path or recorded
    step_m: float | None = 0.2  # of a grid; null: take `every` n-th row and column of a recording
    every: int | None = None  # 2: even rows and even columns
    extent_m: list[float] | None = None  # x and y size of the grid; null: all that the sensor covers
    path: str = "route"  # of the world, where places=path
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    show: int = 20  # places whose pictures go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance")

    def __post_init__(self) -> None:
        if self.places is Source.random:
            raise ConfigError("study.places=random makes no map; give grid, path or recorded")
        if self.places is Source.grid:
            check_step_or_every(self.step_m, self.every)
        check_extent(self.extent_m)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:  # noqa: ARG002
        """Describe, show some, keep."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        plan = parts.sensor.plan(self._layout())
        parts = fitted(parts, plan, record)
        places, omitted = describe_places(parts, plan, record)
        T = places.T_world_camera
        metrics = [
            Metric("places", len(places), "1"),
            Metric("bytes_per_place", places.signatures.nbytes / len(places), "B"),
            Metric("left_out", len(omitted), "1"),
        ]
        if T is not None:
            record.log("places", PlaceMap(T[:, :3, 3], heading_of(T)))
            metrics.append(Metric("step", spacing(T[:, :3, 3]), "m"))
        self._show(parts, plan, places, record)
        record.log("summary", Text(markdown_table(metrics, "Map"), markdown=True))
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}"))
        return Report(metrics, map=places)

    def _show(self, parts: Parts, plan: Plan, places: Places, record: Recorder) -> None:
        """Pictures of some of the places, evenly chosen."""
        at = {key: i for i, key in enumerate(places.keys)}
        chosen = evenly(len(plan), self.show)
        for frames in deliver(parts, plan.at(chosen), record, "pictures"):
            for i, step in enumerate(chosen[frames.plan_index]):
                show_frame(record, frames, i, places.signatures.place[at[frames.keys[i]]], Tick(int(step), int(step)))

    def _layout(self) -> PoseRequest:
        if self.places is Source.recorded:
            return RecordedPoses()
        if self.places is Source.path:
            return NamedPath(self.path, self.height_m)
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)
