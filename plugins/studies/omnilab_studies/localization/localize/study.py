"""Localisation in a map that another run saved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Image,
    Metric,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Tick,
    Trainable,
    check_settings,
    setting,
)
from omnilab.geometry import heading_of, wrap_angle
from omnilab_studies.common.describing import describe
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.localization_metrics import METRIC_NAMES, localization_metrics, map_metrics
from omnilab_studies.common.localization_run import LocalizationRun, answer_row
from omnilab_studies.common.logs import show_frame, start_logs
from omnilab_studies.common.plots import pixels_of
from omnilab_studies.common.pose_sources import Source, query_poses
from omnilab_studies.common.scores import query_table
from omnilab_studies.common.tables import columns_of, markdown_table
from omnilab_studies.localization.figures import localization_figures
from omnilab_studies.localization.layout import LAYOUT
from omnilab_studies.localization.localize.same_pictures import ComparedSensor

TITLE = "Localisation"  # of the summary


@dataclass
class Localize:
    """Localise queries in a saved map (`map=FILE`), with the descriptor and distance that made it.

    Where the sensor knows the poses of the queries the estimates are scored; queries far from every place count as
    having no true place. Queries of a recording without positions are localised and not scored. Localizers of sequences
    (`localizer=bayes_filter`) get the motion between queries where `odometry_noise` is given: the true motion with noise.
    Queries by another camera, in other colours or of another world than the map's are refused, unless `other_pictures`.
    """

    queries: Source = Source.random  # random, path or recorded
    query_count: int = setting(500, at_least=1, at_most=1_000_000)  # how many random queries
    path: str = "route"  # of the world, where queries=path
    heading_step_deg: float | None = setting(
        None, at_least=1e-6, at_most=180
    )  # random headings are multiples of it; null: any heading
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the area of random queries; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    odometry_noise: float | None = setting(
        None, at_least=0
    )  # standard deviation in parts of each motion; null: no odometry
    show: int = setting(100, at_least=0)  # queries whose images go into the logs; the numbers of all of them do
    other_pictures: bool = False  # true: queries by another camera, of another world or colour than the map's are meant

    needs: ClassVar[tuple[str, ...]] = ("sensor", "map", "localizer")  # the map brings descriptor and distance
    metric_names: ClassVar[tuple[str, ...]] = (*METRIC_NAMES, "distance_median")

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Localise; score where the poses of the queries are known."""
        start_logs(record, LAYOUT, parts.sensor)
        plan = parts.sensor.plan(
            query_poses(
                self.queries, self.query_count, self.path, self.heading_step_deg, self.extent_m, self.height_m, rng
            )
        )
        if isinstance(parts.descriptor, Trainable):
            parts = replace(parts, descriptor=parts.descriptor.restore(parts.map.descriptor_state))
        compared = ComparedSensor(parts.sensor, parts.map, parts.descriptor.color, self.other_pictures)
        run = LocalizationRun(replace(parts, sensor=compared), parts.map, record, self.show)
        record.log("places", PlaceMap(run.places_m))
        seed = int(rng.integers(2**32))  # of the disturbances
        if plan.T_world_camera is None:
            return _unscored(run, plan, seed)
        return self._scored(run, plan, seed, self._motion(plan.T_world_camera, rng), rng)

    def _scored(
        self, run: LocalizationRun, plan: Plan, seed: int, motion: Floats | None, rng: np.random.Generator
    ) -> Report:
        """Localise queries whose poses are known: metrics, figures, and `queries.csv` (`query_table`)."""
        scored = run.localize(plan, seed, motion)
        metrics = localization_metrics(scored, len(run.places), run.step_m, rng)
        metrics += map_metrics(run.places, scored, len(run.omitted))
        drawn = localization_figures(run, scored)
        run.record.log("recall", Image(pixels_of(drawn["recall"]), "png"))
        tables = {"queries": query_table(scored, plan.keys)}
        return Report(metrics, tables, drawn, summary=markdown_table(metrics, TITLE), omitted=run.omitted)

    def _motion(self, T_world_camera: Floats, rng: np.random.Generator) -> Floats | None:
        """Simulated odometry: the noisy motion (Q, 3) up to each query; NaN before the first."""
        if self.odometry_noise is None:
            return None
        motion = planar_motion(T_world_camera)
        scale = np.linalg.norm(motion[:, :2], axis=1)[:, None] * [1, 1, 0] + np.abs(motion[:, 2:]) * [0, 0, 1]
        return np.asarray(motion + self.odometry_noise * scale * rng.standard_normal(motion.shape))


def planar_motion(T_world_camera: Floats) -> Floats:
    """Motion (N, 3) up to each pose (N, 4, 4) from the one before: forward, left [m], counter-clockwise [rad]; NaN at first."""
    heading = heading_of(T_world_camera)
    dx, dy = np.diff(T_world_camera[:, :2, 3], axis=0).T
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    moved = np.column_stack([c * dx + s * dy, c * dy - s * dx, wrap_angle(np.diff(heading))])
    return np.concatenate([np.full((1, 3), np.nan), moved])


def _unscored(run: LocalizationRun, plan: Plan, seed: int) -> Report:
    """Localise queries whose poses nobody knows: the estimates alone, as `answers.csv`."""
    rows: list[dict[str, Any]] = []
    omitted = list(plan.omitted)
    for frames in deliver_queries(run.parts, plan, run.record, seed):
        omitted += frames.omitted
        signatures = describe(run.parts.descriptor, frames, run.record)
        with run.record.timed("localise", len(frames)):
            estimates = run.locate(signatures)
        for i, step in enumerate(frames.plan_index):
            rows.append(answer_row(int(step), plan.keys[step], estimates, i))
        step = int(frames.plan_index[0])
        show_frame(run.record, frames, 0, signatures.place[0], Tick(step, int(frames.stamps_ns[0])))
    metrics = [
        Metric("queries", len(rows), "1"),
        Metric(
            "distance_median",
            float(np.median([row["distance"] for row in rows])) if rows else np.nan,
            "1",
            note="no query was delivered",
        ),
        Metric("places", len(run.places), "1"),
    ]
    tables = {"answers": columns_of(rows) if rows else {}}
    return Report(metrics, tables, summary=markdown_table(metrics, TITLE), omitted=omitted)
