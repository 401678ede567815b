"""Study B: a local map of the most alike places and the query, made without their positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from omnilab.api import (
    Frames,
    Parts,
    PlaceMap,
    Plan,
    RandomPoses,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import procrustes
from omnilab_studies.common.frames import deliver, deliver_queries
from omnilab_studies.common.grids import check_extent, check_step, grid_poses
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.methods import Method, descriptors_of, fitted_all, methods_of
from omnilab_studies.local_maps import figures
from omnilab_studies.local_maps.candidates import ShortLists, described, keeping, short_lists
from omnilab_studies.local_maps.embedders import (
    STATE_NS,
    FittedMap,
    makers_of,
    raised,
    settling,
)
from omnilab_studies.local_maps.local_map.layout import LAYOUT
from omnilab_studies.local_maps.results import (
    Trial,
    errors_of,
    first_of,
    metrics_of,
    summary_of,
    table_of,
    times_of,
)
from omnilab_studies.local_maps.runs import Attempts


@dataclass
class LocalMap:
    """Study B: queries localised in maps of their own (Berenguer, thesis, 4.5.2, figures 4.15-4.17).

    The run's descriptor and distance choose the places most alike to a query. Each method measures the distances
    among those and the query, each localizer arranges them in a plane, from several starts; the map is fitted to the
    world (translation, turn, reflection, scale) on its places only, and the error is how far the query then lies from
    where it was taken. Beside it: the map fitted on all its points, which flatters, and the answers that take no map,
    the centroid of the places and the most alike place. Metrics are those of the first step and number of neighbours.
    A descriptor that learns does so on the places of the first step.
    """

    steps_m: list[float] = field(default_factory=lambda: [0.1, 0.2, 0.3, 0.4])  # of the grids of places
    neighbours: list[int] = field(default_factory=lambda: [9, 25, 49])  # places in a map
    query_count: int = 500  # random queries, at any heading
    starts: int = 4  # maps of each query, each from a start of its own and scored apart
    extent_m: list[float] | None = None  # x and y size of the grids; null: all that the sensor covers
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    show: int = 4  # queries whose map is shown as it settles

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizers")

    def __post_init__(self) -> None:
        for step_m in self.steps_m:
            check_step(step_m)
        if not self.steps_m or not self.neighbours:
            raise ConfigError(
                "study.steps_m and study.neighbours try nothing without a value; give one or more of each"
            )
        if min(self.neighbours) < 3:
            raise ConfigError(
                f"study.neighbours={self.neighbours}: {min(self.neighbours)} places span no plane; give 3 or more"
            )
        for name in ("query_count", "starts", "show"):
            if getattr(self, name) < 1:
                raise ConfigError(f"study.{name}={getattr(self, name)} makes no map; give 1 or more")
        check_extent(self.extent_m)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Choose, compare, arrange, fit, score: for every step, number of neighbours, method and localizer."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        makers = makers_of(parts)
        grids = self._grids(parts)
        asked, plan = self._queries(parts, grids, rng)
        chooser, methods = _contestants(parts, next(iter(grids.values())), record)
        seed, *starts = rng.integers(2**32, size=1 + self.starts)

        # the queries: imaged and described once
        shown: list[tuple[Frames, int]] = []
        frames = keeping(deliver_queries(asked, plan, record, int(seed)), shown, self.show)
        queries = described([chooser, *methods], frames, "queries", record)

        # the maps: of every step, by all
        attempts = Attempts(makers, np.array(starts), record)
        omitted = [*queries.omitted, *(sentence for grid in grids.values() for sentence in grid.omitted)]
        for step_m, grid in grids.items():
            frames = deliver(parts, grid, record, f"places, {step_m:g} m")
            places = described([chooser, *methods], frames, "places", record)
            self._check_neighbours(step_m, len(places.position_m))
            omitted += places.omitted
            lists = short_lists(chooser, places, queries, max(self.neighbours), record)
            attempts.make(step_m, lists, methods, self.neighbours)
            if step_m == next(iter(grids)):
                maps = _show(first_of(attempts.trials)[0], lists, attempts, methods, shown, record)

        # what it amounts to
        trials = attempts.trials
        record.log("summary", Text(summary_of(trials), markdown=True))
        for sentence in [*attempts.misfits.values(), *omitted]:
            record.log("log", Text(f"left out: {sentence}"))
        tables = {"local_maps": table_of(trials), "errors": errors_of(trials), "times": times_of(trials)}
        return Report(metrics_of(trials, len(omitted), rng), tables, figures.local_maps(trials, maps))

    def _grids(self, parts: Parts) -> dict[float, Plan]:
        """The places of each step; said early if they are too few."""
        layouts = {step_m: grid_poses(step_m, None, self.extent_m, self.height_m) for step_m in self.steps_m}
        grids = {step_m: parts.sensor.plan(layout) for step_m, layout in layouts.items()}
        for step_m, grid in grids.items():
            self._check_neighbours(step_m, len(grid))
        return grids

    def _check_neighbours(self, step_m: float, places: int) -> None:
        if max(self.neighbours) > places:
            raise DataError(
                f"the map with a step of {step_m:g} m has {places} places, fewer than the {max(self.neighbours)} of"
                f" study.neighbours={list(self.neighbours)}; give fewer neighbours, a smaller step or a larger area"
            )

    def _queries(self, parts: Parts, grids: Mapping[float, Plan], rng: np.random.Generator) -> tuple[Parts, Plan]:  # noqa: ARG002
        """The queries, and the parts that deliver them."""
        extent_m = None if self.extent_m is None else (self.extent_m[0], self.extent_m[1])
        layout = RandomPoses(self.query_count, int(rng.integers(2**32)), None, extent_m, self.height_m)
        return parts, parts.sensor.plan(layout)


def _contestants(parts: Parts, grid: Plan, record: Recorder) -> tuple[Method, list[Method]]:
    """Who chooses the places, and who arranges them. Descriptors that are alike describe once."""
    names = {name for name, descriptor in descriptors_of(methods_of(parts)).items() if descriptor == parts.descriptor}
    learnt = fitted_all(parts, grid, record)
    chooser = Method("choice", min(names, default="choice"), learnt.descriptor, learnt.distance, "distance")
    return chooser, methods_of(learnt)


def _show(
    best: Trial, lists: ShortLists, attempts: Attempts, methods: Sequence[Method],
    shown: Sequence[tuple[Frames, int]], record: Recorder,
) -> list[FittedMap]:  # fmt: skip
    """The best method's maps of the first queries, as they settle; and the error of every query."""
    case = best.case
    places_m, height_m = lists.places_m(case.neighbours), lists.places.position_m[0, 2]
    record.log("places", PlaceMap(lists.places.position_m))
    method = next(method for method in methods if method.name == case.method)
    pairs = lists.pairs(method, case.neighbours, len(shown))
    arrangement = attempts.again(case, pairs)
    step = 0
    maps = []
    for q, (frames, i) in enumerate(shown):
        truth_m = np.vstack([places_m[q], lists.truth_m[q]])
        fit = procrustes(arrangement.position[q, :-1], places_m[q])
        show_picture(record, frames, i, Tick(step, STATE_NS * step))
        record.log("truth", PlaceMap(raised(truth_m, height_m)), Tick(step, STATE_NS * step))
        for graph in settling(arrangement, q, pairs[q], fit, height_m):
            record.log("map", graph, Tick(step, STATE_NS * step))
            step += 1
        maps.append(FittedMap(truth_m, fit.apply(arrangement.position[q])))
    queries = np.arange(len(best.centroid_m))
    for name, error_m in (("map", best.error_m[:, 0]), ("centroid", best.centroid_m)):
        record.log(f"error/{name}", Series(error_m, queries, STATE_NS * queries, "m"))
    return maps
