"""A map of places, described once and saved for other runs."""

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
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of
from omnilab.metrics import spacing
from omnilab_studies.common.describing import describe_places, fitted
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.logs import show_frame, start_logs
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.scores import Degeneracy
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.localization.map.layout import LAYOUT


@dataclass
class MapStudy:
    """Describe the places of a grid, of a path or of a recording, and keep them as `map.npz` in the run's folder.

    Other runs localise in it: `omnilab experiment=localize map=FILE`. It holds signatures, poses, the state of a
    trained descriptor, and the settings of descriptor and distance; no images.
    """

    places: Source = Source.grid  # grid, path or recorded
    step_m: float | None = setting(0.2, above=0)  # of a grid; null: take `every` n-th row and column of a recording
    every: int | None = setting(None, at_least=1)  # 2: even rows and even columns
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    path: str = "route"  # of the world, where places=path
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(20, at_least=0)  # places whose pictures go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance")
    metric_names: ClassVar[tuple[str, ...]] = ("places", "bytes_per_place", "left_out", "step")
    shard_stages: ClassVar[tuple[str, ...]] = ("places",)

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.places is Source.random:
            raise ConfigError("study.places=random makes no map; give grid, path or recorded")
        if self.places is Source.grid:
            check_step_or_every(self.step_m, self.every)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:  # noqa: ARG002
        """Describe the places, log some of them, return the map."""
        start_logs(record, LAYOUT, parts.sensor)
        plan = parts.sensor.plan(self._place_poses())
        parts = fitted(parts, plan, record, is_kept=True)
        places, omitted = describe_places(parts, plan, record)
        if (T := places.T_world_camera) is not None:
            record.log("places", PlaceMap(T[:, :3, 3], heading_of(T)))
        Degeneracy(places).log_map(record)
        self._show(parts, plan, places, record)
        metrics = _metrics(places, len(omitted))
        return Report(metrics, map=places, summary=markdown_table(metrics, "Map"), omitted=omitted)

    def _show(self, parts: Parts, plan: Plan, places: Places, record: Recorder) -> None:
        """Log images and signatures of evenly spaced places."""
        at = {key: i for i, key in enumerate(places.keys)}  # as the plan names them: a sensor's frames may say more
        chosen = evenly(len(plan), self.show)
        for frames in deliver(parts, plan.at(chosen), record, "pictures"):
            for i, step in enumerate(chosen[frames.plan_index]):
                signature = places.signatures.place[at[plan.keys[step]]]
                show_frame(record, frames, i, signature, Tick(int(step), int(step)))

    def _place_poses(self) -> PoseRequest:
        if self.places is Source.recorded:
            return RecordedPoses()
        if self.places is Source.path:
            return NamedPath(self.path, self.height_m)
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)


def _metrics(places: Places, omitted: int) -> list[Metric]:
    found = [
        Metric("places", len(places), "1"),
        Metric("bytes_per_place", places.signatures.nbytes / len(places), "B"),
        Metric("left_out", omitted, "1"),
    ]
    if places.T_world_camera is not None:
        step_m = spacing(places.T_world_camera[:, :3, 3])
        found.append(Metric("step", step_m, "m", note="all places are at one position"))
    return found
