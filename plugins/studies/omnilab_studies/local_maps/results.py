"""Results of local maps: one per step, number of neighbours, method and localizer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bools, Embedding, Floats, Ints, Metric
from omnilab.geometry import procrustes, spanned
from omnilab.metrics import bootstrap
from omnilab_studies.common.tables import markdown

Table = Mapping[str, Sequence[Any]]


class LocalMapCase(NamedTuple):
    """Grid, size of a local map, method and localizer of a result."""

    step_m: float
    neighbours: int
    method: str
    localizer: str


class LocalMapTimes(NamedTuple):
    """Milliseconds a query: the search of all places, the distances among its candidates, one embedding of these."""

    search_ms: float
    pairs_ms: float
    embed_ms: float


class FittedMap(NamedTuple):
    """A map fitted to the world, beside the truth."""

    truth_m: Floats  # (n, 2)
    estimate_m: Floats  # (n, 2)


@dataclass(frozen=True)
class LocalMapResult:
    """Errors of Q queries in S maps each, in metres, beside those of estimates without a map."""

    case: LocalMapCase
    error_m: Floats  # (Q, S) of the map fitted to the world on its places only
    all_points_m: Floats  # (Q, S) of the map fitted to the world on its places and the query's true position
    centroid_m: Floats  # (Q,) of the mean of the places
    nearest_m: Floats  # (Q,) of the most alike place
    stress: Floats  # (Q, S)
    iterations: Ints  # (Q, S)
    on_a_line: Bools  # (Q,) the places lie on one line, at which the map may be mirrored
    places: int  # of the whole map
    times: LocalMapTimes

    @property
    def median_m(self) -> float:
        """Median error over all queries and maps."""
        return float(np.median(self.error_m))

    @property
    def better_than_centroid(self) -> float:
        """Share of the maps whose error is below the centroid's."""
        return float(np.mean(self.error_m < self.centroid_m[:, None]))


def score_local_maps(
    case: LocalMapCase,
    embeddings: Sequence[Embedding],
    places_m: Floats,
    truth_m: Floats,
    places: int,
    times: LocalMapTimes,
) -> LocalMapResult:
    """Fit S maps of Q queries, each its n places and then the query, to the places (Q, n, 2) and score them."""
    all_points_m = np.concatenate([places_m, truth_m[:, None]], axis=1)
    maps = [embedding.position for embedding in embeddings]
    fitted_on_places = [procrustes(plane[:, :-1], places_m).apply(plane) for plane in maps]
    fitted_on_all = [procrustes(plane, all_points_m).apply(plane) for plane in maps]
    return LocalMapResult(
        case,
        _errors(fitted_on_places, truth_m),
        _errors(fitted_on_all, truth_m),
        np.linalg.norm(places_m.mean(axis=1) - truth_m, axis=1),
        np.linalg.norm(places_m[:, 0] - truth_m, axis=1),
        np.stack([embedding.stress for embedding in embeddings], axis=1),
        np.stack([embedding.iterations for embedding in embeddings], axis=1),
        spanned(places_m) < 2,
        places,
        times,
    )


def _errors(maps: Sequence[Floats], truth_m: Floats) -> Floats:
    return np.stack([np.linalg.norm(plane[:, -1] - truth_m, axis=1) for plane in maps], axis=1)


def result_table(results: Sequence[LocalMapResult]) -> Table:
    """The table `local_maps`: one row a result."""
    return {
        **_cases(results),
        "median_m": [r.median_m for r in results],
        "mean_m": [float(r.error_m.mean()) for r in results],
        "p95_m": [float(np.quantile(r.error_m, 0.95)) for r in results],
        "centroid_median_m": [float(np.median(r.centroid_m)) for r in results],
        "nearest_median_m": [float(np.median(r.nearest_m)) for r in results],
        "better_than_centroid": [r.better_than_centroid for r in results],
        "all_points_median_m": [float(np.median(r.all_points_m)) for r in results],
        "stress": [float(np.median(r.stress)) for r in results],
        "iterations": [float(np.median(r.iterations)) for r in results],
        "on_a_line": [int(r.on_a_line.sum()) for r in results],
    }


def time_table(results: Sequence[LocalMapResult]) -> Table:
    """The table `times`: wall time of each result."""
    columns = {name: [getattr(r.times, name) for r in results] for name in LocalMapTimes._fields}
    return {**_cases(results), "places": [r.places for r in results], **columns}


def error_table(results: Sequence[LocalMapResult]) -> Table:
    """The table `errors`: one row per result, query and start."""
    each = [np.indices(r.error_m.shape).reshape(2, -1) for r in results]
    cases = {
        name: [value for r in results for value in [getattr(r.case, name)] * r.error_m.size]
        for name in LocalMapCase._fields
    }
    return {
        **cases,
        "query": np.concatenate([which[0] for which in each]).tolist(),
        "start": np.concatenate([which[1] for which in each]).tolist(),
        "error_m": np.concatenate([r.error_m.ravel() for r in results]).tolist(),
        "centroid_m": np.concatenate([np.repeat(r.centroid_m, r.error_m.shape[1]) for r in results]).tolist(),
    }


def _cases(results: Sequence[LocalMapResult]) -> dict[str, list[Any]]:
    return {name: [getattr(r.case, name) for r in results] for name in LocalMapCase._fields}


def ranking_of_first(results: Sequence[LocalMapResult]) -> list[LocalMapResult]:
    """The results of the first step and number of neighbours, by median error."""
    case = results[0].case
    chosen = [r for r in results if r.case[:2] == case[:2]]
    return sorted(chosen, key=lambda r: r.median_m)


def metrics_of(results: Sequence[LocalMapResult], left_out: int, rng: np.random.Generator) -> list[Metric]:
    """The best of the first step and number of neighbours, and the median error of each one there, by both fits.

    Intervals are bootstrapped over queries: all starts of a query are drawn together.
    """
    ranking = ranking_of_first(results)
    best = ranking[0]
    better = best.error_m < best.centroid_m[:, None]
    return [
        _metric("best_error_median", best.error_m, np.median, "m", rng),
        _metric("centroid_error_median", best.centroid_m, np.median, "m", rng),
        _metric("best_better_than_centroid", better, np.mean, "1", rng),
        *(_metric(f"error_median_{key_of(r.case)}", r.error_m, np.median, "m", rng) for r in ranking),
        *(_metric(f"error_median_all_points_{key_of(r.case)}", r.all_points_m, np.median, "m", rng) for r in ranking),
        Metric("trials", len(results), "1"),
        Metric("queries", len(best.error_m), "1"),
        Metric("starts", best.error_m.shape[1], "1"),
        Metric("left_out", left_out, "1"),
    ]


def _metric(name: str, values: Any, statistic: Any, unit: str, rng: np.random.Generator) -> Metric:
    """A statistic of values (Q, ...), with its bootstrapped interval."""
    interval = bootstrap(lambda chosen: float(statistic(values[chosen])), len(values), rng)
    return Metric(name, float(statistic(values)), unit, interval)


def key_of(case: LocalMapCase) -> str:
    """A method with a localizer, as part of a metric's name."""
    return f"{case.method.replace(' + ', '_')}_{case.localizer}"


def summary_of(results: Sequence[LocalMapResult]) -> str:
    """All results as Markdown, the best of each step and number of neighbours first."""
    shown = ("method", "localizer", "median_m", "p95_m", "better_than_centroid", "all_points_median_m", "stress")
    parts = ["## Local maps"]
    for group in dict.fromkeys(r.case[:2] for r in results):
        ranking = ranking_of_first([r for r in results if r.case[:2] == group])
        centroid, nearest = np.median(ranking[0].centroid_m), np.median(ranking[0].nearest_m)
        table = result_table(ranking)
        parts += [
            f"### {group[0]:g} m, {group[1]} neighbours",
            f"Median errors without a map: centroid {centroid:.3f} m, nearest place {nearest:.3f} m.",
            markdown({name: table[name] for name in shown}),
        ]
    return "\n\n".join(parts)
