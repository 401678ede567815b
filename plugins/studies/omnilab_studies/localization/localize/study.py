"""Localisation in a map that another run saved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Estimates,
    Floats,
    Image,
    Metric,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Text,
    Tick,
    Trainable,
)
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_studies.common import plots
from omnilab_studies.common.describing import deliver_queries, describe, markdown_table, show_frame
from omnilab_studies.common.grids import check_extent
from omnilab_studies.common.localization_run import LocalizationRun
from omnilab_studies.common.pose_sources import Source, layout_without_grid
from omnilab_studies.common.recall import judged, of_map
from omnilab_studies.common.scores import as_table
from omnilab_studies.localization.layout import PLACES


@dataclass
class Localize:
    """Localise queries in a saved map (`map=FILE`), with the descriptor and distance that made it.

    Where the sensor knows where queries were taken the answers are scored; queries far from every place are asked too,
    and counted as having no true place. A recording without positions is answered and not scored. Localizers that follow
    a sequence (`localizer=bayes_filter`) are told the motion between queries with `odometry_noise`: the true one, disturbed.
    """

    queries: Source = Source.random  # random, path or recorded
    query_count: int = 500  # how many random queries
    path: str = "route"  # of the world, where queries=path
    heading_step_deg: float | None = None  # random headings are multiples of it; null: any heading
    extent_m: list[float] | None = None  # x and y size of the area of random queries; null: all that the sensor covers
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    odometry_noise: float | None = None  # standard deviation in parts of each motion; null: no odometry
    show: int = 100  # queries whose images go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "map", "localizer")  # the map brings descriptor and distance

    def __post_init__(self) -> None:
        if self.query_count < 1:
            raise ConfigError(f"study.query_count={self.query_count} asks nothing; give 1 or more")
        if self.odometry_noise is not None and not self.odometry_noise >= 0:
            raise ConfigError(f"study.odometry_noise={self.odometry_noise:g} is no deviation; give 0 or more, or null")
        check_extent(self.extent_m)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Localise; score where that is possible."""
        record.log("", PLACES)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        extent = None if self.extent_m is None else (self.extent_m[0], self.extent_m[1])
        plan = parts.sensor.plan(
            layout_without_grid(
                self.queries, self.query_count, self.path, self.heading_step_deg, extent, self.height_m, rng
            )
        )
        places = parts.map
        if isinstance(parts.descriptor, Trainable):
            parts = replace(parts, descriptor=parts.descriptor.restore(places.descriptor_state))
        run = LocalizationRun(parts, places, record, self.show)
        record.log("places", PlaceMap(run.places_m))

        seed = int(rng.integers(2**32))
        if plan.T_world_camera is None:
            return self._answer(parts, plan, run, record, seed)
        scored = run.ask(plan, seed, self._motion(plan.T_world_camera, rng))
        metrics = [*judged(scored, len(places), run.step_m, rng), *of_map(places, scored, len(run.omitted))]
        drawn = run.figures(scored)
        record.log("recall", Image(plots.pixels_of(drawn["recall"]), "png"))
        _close(record, metrics, run.omitted)
        return Report(metrics, {"queries": as_table(scored, plan.keys)}, drawn)

    def _motion(self, T_world_camera: Floats, rng: np.random.Generator) -> Floats | None:
        """What odometry says of the motion (Q, 3) up to each query; NaN before the first."""
        if self.odometry_noise is None:
            return None
        motion = planar_motion(T_world_camera)
        scale = np.linalg.norm(motion[:, :2], axis=1)[:, None] * [1, 1, 0] + np.abs(motion[:, 2:]) * [0, 0, 1]
        return np.asarray(motion + self.odometry_noise * scale * rng.standard_normal(motion.shape))

    def _answer(self, parts: Parts, plan: Plan, run: LocalizationRun, record: Recorder, seed: int) -> Report:
        """The answers to queries of which nobody knows where they were taken."""
        rows: list[dict[str, Any]] = []
        omitted = list(plan.omitted)
        for frames in deliver_queries(parts, plan, record, seed):
            omitted += frames.omitted
            signatures = describe(parts.descriptor, frames, record)
            with record.timed("localise", len(frames)):
                estimates = run.locate(signatures)
            for i, step in enumerate(frames.plan_index):
                rows.append(_row(int(step), plan.keys[step], estimates, i))
            step = int(frames.plan_index[0])
            show_frame(record, frames, 0, signatures.place[0], Tick(step, int(frames.stamps_ns[0])))
        table = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
        metrics = [
            Metric("queries", len(rows), "1"),
            Metric("distance_median", float(np.median([row["distance"] for row in rows])) if rows else np.nan, "1"),
            Metric("places", len(run.places), "1"),
        ]
        _close(record, metrics, omitted)
        return Report(metrics, {"answers": table})


def planar_motion(T_world_camera: Floats) -> Floats:
    """Forward, left and counter-clockwise motion (N, 3) in m and rad up to each pose (N, 4, 4) from the one before; NaN at first."""
    heading = heading_of(T_world_camera)
    dx, dy = np.diff(T_world_camera[:, :2, 3], axis=0).T
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    moved = np.column_stack([c * dx + s * dy, c * dy - s * dx, wrap_angle(np.diff(heading))])
    return np.concatenate([np.full((1, 3), np.nan), moved])


def _row(step: int, key: str, estimates: Estimates, i: int) -> dict[str, Any]:
    x, y, z = estimates.position_m[i].tolist()
    heading = np.nan if estimates.heading_rad is None else float(np.rad2deg(estimates.heading_rad[i]))
    return {
        "query": step, "key": key, "place": int(estimates.place[i]), "answer_x_m": x, "answer_y_m": y, "answer_z_m": z,
        "answer_heading_deg": heading, "distance": float(estimates.distance[i]),
    }  # fmt: skip


def _close(record: Recorder, metrics: list[Metric], omitted: Sequence[str]) -> None:
    record.log("summary", Text(markdown_table(metrics, "Localisation"), markdown=True))
    for sentence in omitted:
        record.log("log", Text(f"left out: {sentence}"))
