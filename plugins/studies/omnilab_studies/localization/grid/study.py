"""Study A: localisation on a grid of places with known positions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from omnilab.api import (
    GridPoses,
    Image,
    Parts,
    PlaceMap,
    PoseRequest,
    RandomPoses,
    RecordedPoses,
    Recorder,
    Report,
    Text,
)
from omnilab.errors import ConfigError
from omnilab_studies.common import plots
from omnilab_studies.common.describing import describe_places, fitted, markdown_table
from omnilab_studies.common.grids import check_extent, check_step_or_every, grid_poses
from omnilab_studies.common.localization_run import LocalizationRun
from omnilab_studies.common.recall import judged, of_map
from omnilab_studies.common.scores import as_table
from omnilab_studies.localization.layout import PLACES


class Queries(Enum):
    """Where queries come from."""

    random = "random"  # poses drawn in the map's area
    rest = "rest"  # the recorded images that are not places


@dataclass
class Grid:
    """Study A: describe a grid of places, localise queries, score the answers (Berenguer, thesis, 4.5.1, fig. 4.13).

    An answer is `nearest` if no place lies closer to where the query was taken (ties within 1 mm count), `second` if
    it is at the next distance, else `wrong`. Beside the rates: errors of position and heading, the sharpness C of the
    distances over the map (eq. 4.6), and the bytes a place takes. Disturbances spoil the queries, never the places.
    """

    step_m: float | None = 0.2  # of the grid of places; null: take `every` n-th row and column of a recording
    every: int | None = None  # 2: even rows and even columns
    queries: Queries = Queries.random  # random poses, or the rest of a recording
    query_count: int = 3500  # how many random queries
    heading_step_deg: float | None = None  # random headings are multiples of it; null: any heading
    extent_m: list[float] | None = None  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    show: int = 100  # queries whose images go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer")

    def __post_init__(self) -> None:
        check_step_or_every(self.step_m, self.every)
        if self.every is not None and self.every < 1:
            raise ConfigError(f"study.every={self.every} takes no rows; give 1 or more")
        if self.query_count < 1:
            raise ConfigError(f"study.query_count={self.query_count} asks nothing; give 1 or more")
        if self.show < 0:
            raise ConfigError(f"study.show={self.show} shows nothing; give 0 for no pictures, or how many")
        check_extent(self.extent_m)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map, localise, score."""
        record.log("", PLACES)
        if scene := parts.sensor.scene():
            record.log("room", scene)

        # the map: every place of the grid, described
        plan = parts.sensor.plan(self._layout(rng))  # of the queries: what cannot be had is said before the work begins
        grid = parts.sensor.plan(self._grid())
        parts = fitted(parts, grid, record)
        places, omitted = describe_places(parts, grid, record)
        run = LocalizationRun(parts, places, record, self.show)
        record.log("places", PlaceMap(run.places_m))

        # the queries: localised batch by batch, and scored against where they were taken
        seed = int(rng.integers(2**32))  # of the disturbances; drawn after the poses, so that they change none
        scored = run.ask(plan, seed)
        omitted += run.omitted

        # what it amounts to
        metrics = [*judged(scored, len(places), run.step_m, rng), *of_map(places, scored, len(omitted))]
        drawn = run.figures(scored) | {"worst": run.worst(plan, scored, seed)}
        record.log("recall", Image(plots.pixels_of(drawn["recall"]), "png"))
        record.log("summary", Text(markdown_table(metrics, "Grid study"), markdown=True))
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}"))
        return Report(metrics, {"queries": as_table(scored, plan.keys)}, drawn)

    def _grid(self) -> GridPoses:
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)

    def _layout(self, rng: np.random.Generator) -> PoseRequest:
        if self.queries is Queries.rest:
            return RecordedPoses(without=self._grid())
        step = None if self.heading_step_deg is None else float(np.deg2rad(self.heading_step_deg))
        seed = int(rng.integers(2**32))
        return RandomPoses(self.query_count, seed, step, self._grid().extent_m, self.height_m)
