"""The study `joint`: position and height at once, from one map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Parts, PlaceMap, Plan, Recorder, Report, Series, Tick, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_studies.altitude.joint import figures
from omnilab_studies.altitude.joint.layout import LAYOUT
from omnilab_studies.altitude.joint.results import JointResult, metrics_of, query_rows, rises_m, row_of, scale_of
from omnilab_studies.common.describing import describe, describe_places, fitted
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.localization_run import LocalizationRun, estimate_of
from omnilab_studies.common.logs import show_frame, start_logs
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.common.scores import joined_estimates
from omnilab_studies.common.tables import columns_of, markdown

OFFSET_NS = 100_000_000  # between two heights, in the logs


@dataclass
class Joint:
    """Localise above and below a map, and estimate the height there: the estimated place is the altimeter's reference.

    The map lies at one height; queries are at random poses at each of `offsets_m` above it. Measured are the rate of
    right places as the queries leave the map's height, and the altimeter's estimates over the estimated place's image:
    their sign, and after one scale for all queries their error in metres (Berenguer, thesis, 7.2, names it as future
    work).
    """

    step_m: float = setting(0.4, above=0)  # of the grid of places
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float = setting(0.6, at_least=-1e6, at_most=1e6)  # of the map
    offsets_m: list[float] = setting([-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.5], fewest=1)  # of the queries
    query_count: int = setting(60, at_least=1, at_most=1_000_000)  # at each height

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer", "altimeter")
    metric_names: ClassVar[tuple[str, ...]] = (
        "nearest_rate", "height_error_median", "sign_rate", "nearest_rate_level", "scale", "nearest_rate_HEIGHT",
        "height_error_median_HEIGHT",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if not self.offsets_m or self.height_m + min(self.offsets_m) <= 0:
            raise ConfigError(
                f"study.offsets_m={self.offsets_m} leave nothing above the floor from a map at {self.height_m:g} m; give"
                " some, each above minus that"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map at one height; localise at others; estimate the height over the estimated place."""
        start_logs(record, LAYOUT, parts.sensor)
        plans = self._query_plans(parts, int(rng.integers(2**32)))
        grid = parts.sensor.plan(grid_poses(self.step_m, None, self.extent_m, self.height_m))
        parts = fitted(parts, grid, record)
        places, omitted = describe_places(parts, grid, record)
        run = LocalizationRun(parts, places, record, show=0)
        record.log("places", PlaceMap(run.places_m))

        results = []
        for step, (offset_m, plan) in enumerate(zip(self.offsets_m, plans, strict=True)):
            results.append(_localize(parts, run, plan, offset_m, int(rng.integers(2**32)), step))
            omitted += plan.omitted
        run.log_degeneracy()
        scale = scale_of(results)
        rows = [row_of(one, scale, self.step_m, rng) for one in results]
        _show(rows, record)
        return _report(rows, results, scale, omitted)

    def _query_plans(self, parts: Parts, seed: int) -> list[Plan]:
        """Random poses at each height."""
        heights = [self.height_m + offset for offset in self.offsets_m]
        requests = [random_poses(self.query_count, seed + i, None, self.extent_m, z) for i, z in enumerate(heights)]
        return [parts.sensor.plan(request) for request in requests]


def _localize(parts: Parts, run: LocalizationRun, plan: Plan, offset_m: float, seed: int, step: int) -> JointResult:
    """Localise the queries of one height, and estimate their heights over the estimated places."""
    scored, values, unit = [], [], ""
    for frames in deliver_queries(parts, plan, run.record, seed):
        signatures = describe(parts.descriptor, frames, run.record)
        scored.append(run.score(frames, signatures, run.locate(signatures)))
        with run.record.timed("height", len(frames)):
            heights = parts.altimeter.relative(run.pictures(scored[-1].place), frames.images, frames.camera)
        values.append(heights.value)
        unit = heights.unit
        if len(scored) == 1:
            tick = Tick(step, OFFSET_NS * step)
            show_frame(run.record, frames, 0, signatures.place[0], tick)
            run.record.log("estimate", estimate_of(scored[0], 0), tick)
    whole = joined_estimates(scored)
    rise_m = whole.truth_m[:, 2] - run.places_m[whole.place, 2]
    return JointResult(offset_m, whole, np.concatenate(values), rise_m, unit)


def _show(rows: Sequence[Mapping[str, Any]], record: Recorder) -> None:
    """Log the rate of nearest places and the estimated height, a height a step."""
    for step, row in enumerate(rows):
        at = np.array([step]), np.array([OFFSET_NS * step])
        record.log("nearest", Series(np.array([row["nearest_rate"]]), *at, "1"))
        for name in ("offset_m", "estimate_median_m"):
            record.log(f"height/{name}", Series(np.array([row[name]]), *at, "m"))


def _report(
    rows: Sequence[Mapping[str, Any]], results: Sequence[JointResult], scale: float, omitted: Sequence[str]
) -> Report:
    table = columns_of(rows)
    return Report(
        metrics_of(rows, results, scale),
        {"joint": table, "queries": query_rows(results, scale)},
        {"joint": figures.joint(rows, rises_m(results, scale))},
        summary=f"## Position and height\n\n{markdown(table)}",
        omitted=omitted,
    )
