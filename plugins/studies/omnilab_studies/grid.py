"""Study A: localisation on a grid of places with known positions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Answers,
    DistanceField,
    Estimate,
    Floats,
    Frames,
    GridPoses,
    Layout,
    Metric,
    Parts,
    PlaceMap,
    Places,
    Plan,
    RandomPoses,
    RecordedPoses,
    Recorder,
    Report,
    Series,
    Signatures,
    Text,
    Tick,
)
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of
from omnilab.metrics import VERDICTS
from omnilab_studies import figures
from omnilab_studies.common import (
    deliver_queries,
    describe,
    describe_places,
    disturbed,
    fitted,
    markdown_table,
    show_frame,
    statistics,
)
from omnilab_studies.grids import check_extent, check_step_or_every, grid_poses
from omnilab_studies.layouts import PLACES
from omnilab_studies.scoring import Scored, as_table, joined, known_poses, score

EXAMPLE_M = (-2.239, -1.653)  # x, y: the query nearest to it has its distance surface drawn (thesis, figure 4.12)
WORST = 6  # wrong answers shown in a figure


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
        places_m = known_poses(places.T_world_camera, "places")[:, :3, 3]
        record.log("places", PlaceMap(places_m))
        with record.timed("prepare the map"):
            index = parts.localizer.prepare(places, parts.distance)

        # the queries: localised batch by batch, and scored against where they were taken
        example = _Example()
        batches: list[Scored] = []
        seed = int(rng.integers(2**32))  # of the disturbances; drawn last, so that they change no pose
        for frames in deliver_queries(parts, plan, record, seed):
            omitted += frames.omitted
            signatures = describe(parts.descriptor, frames, record)
            with record.timed("localise", len(frames)):
                estimates = parts.localizer.locate(signatures, index)
            batches.append(score(frames, estimates, places_m))
            example.offer(batches[-1], estimates.field)
            self._log(record, frames, signatures, batches[-1], estimates.field, places_m, len(plan))
        scored = joined(batches)

        # what it amounts to
        record.log("answers", Answers(scored.truth_m, scored.answer_m, list(scored.verdict)))
        metrics = _metrics(scored, places, omitted)
        record.log("summary", Text(markdown_table(metrics, "Grid study"), markdown=True))
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}"))
        drawn = _figures(parts, plan, scored, places, example, seed)
        return Report(metrics, {"queries": as_table(scored, plan.keys)}, drawn)

    def _grid(self) -> GridPoses:
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)

    def _layout(self, rng: np.random.Generator) -> Layout:
        if self.queries is Queries.rest:
            return RecordedPoses(without=self._grid())
        step = None if self.heading_step_deg is None else float(np.deg2rad(self.heading_step_deg))
        seed = int(rng.integers(2**32))
        return RandomPoses(self.query_count, seed, step, self._grid().extent_m, self.height_m)

    def _log(
        self, record: Recorder, frames: Frames, signatures: Signatures, scored: Scored,
        field: Floats | None, places_m: Floats, total: int,
    ) -> None:  # fmt: skip
        """Numbers of every query, pictures of some."""
        steps, stamps = scored.plan_index, scored.stamps_ns
        record.log("error/position_m", Series(scored.error_m, steps, stamps, "m"))
        if scored.has_headings:
            record.log("error/heading_deg", Series(scored.heading_error_deg, steps, stamps, "deg"))
        every = max(1, -(-total // self.show)) if self.show > 0 else total + 1
        for i in np.flatnonzero((steps + 1) % every == 0):
            tick = Tick(int(steps[i]), int(stamps[i]))
            show_frame(record, frames, int(i), signatures.place[i], tick)
            if field is not None:
                record.log("distances", DistanceField(places_m, field[i]), tick)
            heading = float(scored.answer_heading_rad[i])
            record.log(
                "estimate",
                Estimate(
                    scored.truth_m[i], scored.answer_m[i], str(scored.verdict[i]),
                    float(heading_of(scored.truth[i])), heading if np.isfinite(heading) else None,
                ),
                tick,
            )  # fmt: skip


@dataclass
class _Example:
    """The query nearest to the thesis's example, with its distances to all places."""

    field: Floats | None = None  # (P,)
    truth_m: Floats | None = None  # (3,)
    answer_m: Floats | None = None  # (3,)

    def offer(self, scored: Scored, field: Floats | None) -> None:
        """Keep the best of a batch if it beats what there is."""
        if field is None:
            return
        away = np.linalg.norm(scored.truth_m[:, :2] - EXAMPLE_M, axis=1)
        best = int(away.argmin())
        if self.truth_m is None or away[best] < np.linalg.norm(self.truth_m[:2] - EXAMPLE_M):
            self.field, self.truth_m, self.answer_m = field[best], scored.truth_m[best], scored.answer_m[best]


def _metrics(scored: Scored, places: Places, omitted: list[str]) -> list[Metric]:
    found = [Metric(f"{verdict}_rate", float(np.mean(scored.verdict == verdict)), "1") for verdict in VERDICTS]
    found += statistics("position_error", scored.error_m, "m")
    if scored.has_headings:
        found += statistics("heading_error", scored.heading_error_deg, "deg")
    if np.isfinite(scored.sharpness).all():
        found.append(Metric("sharpness_mean", float(scored.sharpness.mean()), "1"))
    return [
        *found,
        Metric("places", len(places), "1"),
        Metric("queries", len(scored.place), "1"),
        Metric("left_out", len(omitted), "1"),
        Metric("bytes_per_place", places.signatures.nbytes / len(places), "B"),
    ]


def _figures(parts: Parts, plan: Plan, scored: Scored, places: Places, example: _Example, seed: int) -> dict[str, Any]:
    places_m = known_poses(places.T_world_camera, "places")[:, :3, 3]
    worst = np.argsort(-scored.error_m, kind="stable")[:WORST]
    asked = parts.sensor.frames(plan.at(scored.plan_index[worst]))
    queries = [image for frames in asked for image in disturbed(frames, parts.disturbances, seed).images]
    answers = parts.sensor.frames(Plan(places.keys, places.T_world_camera).at(scored.place[worst]))
    answered = [image for frames in answers for image in frames.images]
    drawn = {
        "success": figures.success(scored.verdict),
        "error_map": figures.error_map(places_m, scored.truth_m, scored.answer_m, scored.error_m, scored.verdict),
        "worst": figures.worst(queries, answered, scored.error_m[worst], scored.verdict[worst]),
    }
    if example.field is not None and example.truth_m is not None and example.answer_m is not None:
        drawn["distance_surface"] = figures.surface(places_m, example.field, example.truth_m, example.answer_m)
    return drawn
