"""Study B: a local map of the most alike places and the query, made without their positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Frames, Parts, PlaceMap, Plan, Recorder, Report, Series, Tick, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import procrustes
from omnilab_studies.common.frames import deliver, deliver_queries
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.methods import Method, descriptors_of, fitted_all, methods_of
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.local_maps import figures
from omnilab_studies.local_maps.candidates import (
    Candidates,
    DescribedImages,
    describe_images,
    find_candidates,
    keep_first,
)
from omnilab_studies.local_maps.display import STATE_NS, at_height, settling
from omnilab_studies.local_maps.embedders import embedders_of
from omnilab_studies.local_maps.local_map.layout import LAYOUT
from omnilab_studies.local_maps.results import (
    FittedMap,
    LocalMapResult,
    error_table,
    metrics_of,
    ranking_of_first,
    result_table,
    summary_of,
    time_table,
)
from omnilab_studies.local_maps.runs import LocalMapRuns


@dataclass
class LocalMap:
    """Study B: queries localised in maps of their own (Berenguer, thesis, 4.5.2, figures 4.15-4.17).

    The run's descriptor and distance find the places most alike to a query, its candidates. Each method measures the
    distances among those and the query, each localizer embeds them in a plane, from several starts; the map is fitted
    to the world (translation, rotation, reflection, scale) on its places only, and the error is the distance from the
    query's position in it to the true one. Beside it: the error of the map fitted on all its points, which is too small,
    and those of estimates without a map, the centroid of the candidates and the most alike place. Metrics are those of
    the first step and number of neighbours. A descriptor to be trained is trained on the places of the first step.
    """

    steps_m: list[float] = setting([0.1, 0.2, 0.3, 0.4], above=0, fewest=1)  # of the grids of places
    neighbours: list[int] = setting([9, 25, 49], at_least=3, at_most=10_000, fewest=1)  # places in a map
    query_count: int = setting(500, at_least=1, at_most=1_000_000)  # random queries, at any heading
    starts: int = setting(
        4, at_least=1, at_most=10_000
    )  # maps of each query, each from a start of its own and scored apart
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grids; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(4, at_least=1)  # queries whose map is shown as it settles

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizers")
    metric_names: ClassVar[tuple[str, ...]] = (
        "best_error_median", "centroid_error_median", "best_better_than_centroid", "error_median_METHOD_LOCALIZER",
        "error_median_all_points_METHOD_LOCALIZER", "trials", "queries", "starts", "left_out",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Find candidates, measure their distances, embed, fit, score: per step, number of neighbours, method, localizer."""
        start_logs(record, LAYOUT, parts.sensor)
        embedders = embedders_of(parts)
        grids = self._grids(parts)
        query_parts, query_plan = self._queries(parts, grids, rng)
        retrieval, methods = _methods(parts, next(iter(grids.values())), record)
        seed, *starts = rng.integers(2**32, size=1 + self.starts)

        shown: list[tuple[Frames, int]] = []
        frames = keep_first(deliver_queries(query_parts, query_plan, record, int(seed)), shown, self.show)
        queries = describe_images([retrieval, *methods], frames, len(query_plan), "queries", record)

        runs = LocalMapRuns(embedders, np.array(starts), record)
        omitted = [*queries.omitted, *(sentence for grid in grids.values() for sentence in grid.omitted)]
        maps: list[FittedMap] = []
        for step_m, grid in grids.items():
            places = self._describe_places(parts, step_m, grid, [retrieval, *methods], record)
            omitted += places.omitted
            candidates = find_candidates(retrieval, places, queries, max(self.neighbours), record)
            runs.run(step_m, candidates, methods, self.neighbours)
            if not maps:
                maps = _show(ranking_of_first(runs.results)[0], candidates, runs, methods, shown, record)
        return _report(runs, maps, omitted, rng)

    def _grids(self, parts: Parts) -> dict[float, Plan]:
        """The places of each step; DataError before any work if they are too few."""
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
        """The parts that deliver the queries, and the plan of these."""
        request = random_poses(self.query_count, int(rng.integers(2**32)), None, self.extent_m, self.height_m)
        return parts, parts.sensor.plan(request)

    def _describe_places(
        self, parts: Parts, step_m: float, grid: Plan, methods: Sequence[Method], record: Recorder
    ) -> DescribedImages:
        """The places of one step; DataError if too few could be delivered."""
        frames = deliver(parts, grid, record, f"places, {step_m:g} m")
        places = describe_images(methods, frames, len(grid), "places", record)
        self._check_neighbours(step_m, len(places.position_m))
        return places


def _methods(parts: Parts, grid: Plan, record: Recorder) -> tuple[Method, list[Method]]:
    """The retrieval method that finds candidates, and the methods that measure them. Equal descriptors describe once."""
    names = {name for name, descriptor in descriptors_of(methods_of(parts)).items() if descriptor == parts.descriptor}
    trained = fitted_all(parts, grid, record)
    retrieval = Method("choice", min(names, default="choice"), trained.descriptor, trained.distance, "distance")
    return retrieval, methods_of(trained)


def _show(
    best: LocalMapResult, candidates: Candidates, runs: LocalMapRuns, methods: Sequence[Method],
    shown: Sequence[tuple[Frames, int]], record: Recorder,
) -> list[FittedMap]:  # fmt: skip
    """Log the best method's maps of the first queries, as they settle, and the error of every query."""
    case = best.case
    places_m, height_m = candidates.places_m(case.neighbours), candidates.places.position_m[0, 2]
    record.log("places", PlaceMap(candidates.places.position_m))
    method = next(method for method in methods if method.name == case.method)
    pairs = candidates.pairwise_distances(method, case.neighbours, len(shown))
    embedding = runs.embed_with_states(case, pairs)
    step = 0
    maps = []
    for q, (frames, i) in enumerate(shown):
        truth_m = np.vstack([places_m[q], candidates.truth_m[q]])
        fit = procrustes(embedding.position[q, :-1], places_m[q])
        show_picture(record, frames, i, Tick(step, STATE_NS * step))
        record.log("truth", PlaceMap(at_height(truth_m, height_m)), Tick(step, STATE_NS * step))
        for graph in settling(embedding, q, pairs[q], fit, height_m):
            record.log("map", graph, Tick(step, STATE_NS * step))
            step += 1
        maps.append(FittedMap(truth_m, fit.apply(embedding.position[q])))
    queries = np.arange(len(best.centroid_m))
    for name, error_m in (("map", best.error_m[:, 0]), ("centroid", best.centroid_m)):
        record.log(f"error/{name}", Series(error_m, queries, STATE_NS * queries, "m"))
    return maps


def _report(runs: LocalMapRuns, maps: Sequence[FittedMap], omitted: Sequence[str], rng: np.random.Generator) -> Report:
    results = runs.results
    return Report(
        metrics_of(results, len(omitted), rng),
        {"local_maps": result_table(results), "errors": error_table(results), "times": time_table(results)},
        figures.local_map_figures(results, maps),
        summary=summary_of(results),
        omitted=[*runs.unsuited.values(), *omitted],
    )
