"""Study A: localisation in a map of places on a grid (thesis, 4.5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from omnilab.api import (
    GridPoses,
    Image,
    Parts,
    PlaceMap,
    Plan,
    PoseRequest,
    RecordedPoses,
    Recorder,
    Report,
    check_settings,
    setting,
)
from omnilab_studies.common.describing import describe_places, fitted
from omnilab_studies.common.frames import at_once, disturbed
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.localization_metrics import METRIC_NAMES, localization_metrics, map_metrics
from omnilab_studies.common.localization_run import LocalizationRun
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.plots import pixels_of
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.common.scores import ScoredEstimates, query_table
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.localization.figures import localization_figures
from omnilab_studies.localization.grid.figures import worst
from omnilab_studies.localization.layout import LAYOUT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORST = 6  # queries with the largest errors, shown in a figure


class Queries(Enum):
    """Where queries come from."""

    random = "random"  # poses drawn in the map's area
    rest = "rest"  # the recorded images that are not places


@dataclass
class Grid:
    """Study A: describe a grid of places, localise queries, score the estimates (Berenguer, thesis, 4.5.1, fig. 4.13).

    An estimate is `nearest` if no place lies closer to where the query was taken (ties count, see `omnilab.metrics`), `second` if
    it is at the next distance, else `wrong`. Beside the rates: errors of position and heading, the sharpness C of the
    distances over the map (eq. 4.6), and the bytes a place takes. Disturbances apply to the queries, never to the places.
    """

    step_m: float | None = setting(
        0.2, above=0
    )  # of the grid of places; null: take `every` n-th row and column of a recording
    every: int | None = setting(None, at_least=1)  # 2: even rows and even columns
    queries: Queries = Queries.random  # random poses, or the rest of a recording
    query_count: int = setting(3500, at_least=1, at_most=1_000_000)  # how many random queries
    heading_step_deg: float | None = setting(
        None, at_least=1e-6, at_most=180
    )  # random headings are multiples of it; null: any heading
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(100, at_least=0)  # queries whose images go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer")
    metric_names: ClassVar[tuple[str, ...]] = METRIC_NAMES
    shard_stages: ClassVar[tuple[str, ...]] = ("places", "queries")

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_step_or_every(self.step_m, self.every)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the places, localise the queries, score: `queries.csv` has a row per query (`query_table`)."""
        start_logs(record, LAYOUT, parts.sensor)
        plan = parts.sensor.plan(self._query_poses(rng))  # first: queries that do not exist fail before the work begins
        parts.shards.check("queries", len(plan), at_once(parts))
        run, omitted = self._map(parts, record)

        seed = int(rng.integers(2**32))  # of the disturbances; drawn after the poses, so that they change none
        scored = run.localize(plan, seed)
        omitted += run.omitted

        metrics = localization_metrics(scored, len(run.places), run.step_m, rng)
        metrics += map_metrics(run.places, scored, len(omitted))
        drawn = localization_figures(run, scored) | {"worst": _worst(run, plan, scored, seed)}
        record.log("recall", Image(pixels_of(drawn["recall"]), "png"))
        tables = {"queries": query_table(scored, plan.keys)}
        return Report(metrics, tables, drawn, summary=markdown_table(metrics, "Grid study"), omitted=omitted)

    def _map(self, parts: Parts, record: Recorder) -> tuple[LocalizationRun, list[str]]:
        """The places of the grid described, and ready to localise in; and what was left out."""
        grid = parts.sensor.plan(self._grid())
        parts = fitted(parts, grid, record)
        places, omitted = describe_places(parts, grid, record)
        run = LocalizationRun(parts, places, record, self.show)
        record.log("places", PlaceMap(run.places_m))
        return run, omitted

    def _grid(self) -> GridPoses:
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)

    def _query_poses(self, rng: np.random.Generator) -> PoseRequest:
        if self.queries is Queries.rest:
            return RecordedPoses(without=self._grid())
        seed = int(rng.integers(2**32))
        return random_poses(self.query_count, seed, self.heading_step_deg, self.extent_m, self.height_m)


def _worst(run: LocalizationRun, plan: Plan, scored: ScoredEstimates, seed: int) -> Figure:
    """The figure of the largest errors, its images taken anew: queries beside the places they were taken for."""
    chosen = np.argsort(-scored.error_m, kind="stable")[:WORST]
    frames = run.parts.sensor.frames(plan.at(scored.plan_index[chosen]))
    queries = [image for batch in frames for image in disturbed(batch, run.parts.disturbances, seed).images]
    answers = run.pictures(scored.place[chosen])
    return worst(queries, list(answers), scored.error_m[chosen], scored.verdict[chosen])
