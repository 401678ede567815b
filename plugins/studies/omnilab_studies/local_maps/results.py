"""What came of local maps: one trial per step, number of neighbours, method and localizer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Embedding, Floats, Ints, Metric
from omnilab.geometry import procrustes, spanned
from omnilab.metrics import bootstrap
from omnilab_studies.common.tables import markdown

Table = Mapping[str, Sequence[Any]]


class Case(NamedTuple):
    """What a trial is of."""

    step_m: float
    neighbours: int
    method: str
    localizer: str


class Times(NamedTuple):
    """Milliseconds a query: comparing it with the map, comparing its places with each other, arranging them once."""

    search_ms: float
    pairs_ms: float
    arrange_ms: float


@dataclass(frozen=True)
class Trial:
    """The errors of Q queries in S maps each, in metres, beside those of answers that take no map at all."""

    case: Case
    error_m: Floats  # (Q, S) of the map fitted to the world on its places only
    all_points_m: Floats  # (Q, S) of the map fitted on its places and where the query truly is
    centroid_m: Floats  # (Q,) of the mean of the places
    nearest_m: Floats  # (Q,) of the most alike place
    stress: Floats  # (Q, S)
    iterations: Ints  # (Q, S)
    on_a_line: npt.NDArray[np.bool_]  # (Q,) the places lie on one line, at which the map may be mirrored
    places: int  # of the whole map
    times: Times

    @property
    def median_m(self) -> float:
        return float(np.median(self.error_m))

    @property
    def better(self) -> float:
        """How often the map's error is below the centroid's."""
        return float(np.mean(self.error_m < self.centroid_m[:, None]))


def trial_of(
    case: Case, made: Sequence[Embedding], places_m: Floats, truth_m: Floats, places: int, times: Times
) -> Trial:
    """Fit S maps of Q queries, each its n places and then the query, to the places (Q, n, 2) and score them."""
    everyone = np.concatenate([places_m, truth_m[:, None]], axis=1)
    maps = [arrangement.position for arrangement in made]
    fitted = [procrustes(plane[:, :-1], places_m).apply(plane) for plane in maps]
    flattered = [procrustes(plane, everyone).apply(plane) for plane in maps]
    return Trial(
        case,
        _errors(fitted, truth_m),
        _errors(flattered, truth_m),
        np.linalg.norm(places_m.mean(axis=1) - truth_m, axis=1),
        np.linalg.norm(places_m[:, 0] - truth_m, axis=1),
        np.stack([arrangement.stress for arrangement in made], axis=1),
        np.stack([arrangement.iterations for arrangement in made], axis=1),
        spanned(places_m) < 2,
        places,
        times,
    )


def _errors(maps: Sequence[Floats], truth_m: Floats) -> Floats:
    return np.stack([np.linalg.norm(plane[:, -1] - truth_m, axis=1) for plane in maps], axis=1)


def table_of(trials: Sequence[Trial]) -> Table:
    """One row a trial."""
    return {
        **_cases(trials),
        "median_m": [t.median_m for t in trials],
        "mean_m": [float(t.error_m.mean()) for t in trials],
        "p95_m": [float(np.quantile(t.error_m, 0.95)) for t in trials],
        "centroid_median_m": [float(np.median(t.centroid_m)) for t in trials],
        "nearest_median_m": [float(np.median(t.nearest_m)) for t in trials],
        "better_than_centroid": [t.better for t in trials],
        "all_points_median_m": [float(np.median(t.all_points_m)) for t in trials],
        "stress": [float(np.median(t.stress)) for t in trials],
        "iterations": [float(np.median(t.iterations)) for t in trials],
        "on_a_line": [int(t.on_a_line.sum()) for t in trials],
    }


def times_of(trials: Sequence[Trial]) -> Table:
    """What each trial cost, on whatever else the machine did."""
    columns = {name: [getattr(t.times, name) for t in trials] for name in Times._fields}
    return {**_cases(trials), "places": [t.places for t in trials], **columns}


def errors_of(trials: Sequence[Trial]) -> Table:
    """Every error: one row per trial, query and start."""
    each = [np.indices(t.error_m.shape).reshape(2, -1) for t in trials]
    cases = {
        name: [value for t in trials for value in [getattr(t.case, name)] * t.error_m.size] for name in Case._fields
    }
    return {
        **cases,
        "query": np.concatenate([which[0] for which in each]).tolist(),
        "start": np.concatenate([which[1] for which in each]).tolist(),
        "error_m": np.concatenate([t.error_m.ravel() for t in trials]).tolist(),
        "centroid_m": np.concatenate([np.repeat(t.centroid_m, t.error_m.shape[1]) for t in trials]).tolist(),
    }


def _cases(trials: Sequence[Trial]) -> dict[str, list[Any]]:
    return {name: [getattr(t.case, name) for t in trials] for name in Case._fields}


def first_of(trials: Sequence[Trial]) -> list[Trial]:
    """Those of the first step and number of neighbours, best first."""
    case = trials[0].case
    chosen = [t for t in trials if t.case[:2] == case[:2]]
    return sorted(chosen, key=lambda t: t.median_m)


def metrics_of(trials: Sequence[Trial], left_out: int, rng: np.random.Generator) -> list[Metric]:
    """The best of the first step and number of neighbours, and the median error of each one there.

    Intervals are of other queries: all starts of a query are drawn together.
    """
    ranking = first_of(trials)
    best = ranking[0]
    better = best.error_m < best.centroid_m[:, None]
    return [
        _metric("best_error_median", best.error_m, np.median, "m", rng),
        _metric("centroid_error_median", best.centroid_m, np.median, "m", rng),
        _metric("best_better_than_centroid", better, np.mean, "1", rng),
        *(_metric(f"error_median_{key_of(t.case)}", t.error_m, np.median, "m", rng) for t in ranking),
        Metric("trials", len(trials), "1"),
        Metric("queries", len(best.error_m), "1"),
        Metric("starts", best.error_m.shape[1], "1"),
        Metric("left_out", left_out, "1"),
    ]


def _metric(name: str, values: Any, statistic: Any, unit: str, rng: np.random.Generator) -> Metric:
    """A statistic of values (Q, ...), with its interval."""
    interval = bootstrap(lambda chosen: float(statistic(values[chosen])), len(values), rng)
    return Metric(name, float(statistic(values)), unit, interval)


def key_of(case: Case) -> str:
    """A method with a localizer, as part of a metric's name."""
    return f"{case.method.replace(' + ', '_')}_{case.localizer}"


def summary_of(trials: Sequence[Trial]) -> str:
    """All trials as Markdown, the best of each step and number of neighbours first."""
    shown = ("method", "localizer", "median_m", "p95_m", "better_than_centroid", "all_points_median_m", "stress")
    parts = ["## Local maps"]
    for group in dict.fromkeys(t.case[:2] for t in trials):
        ranking = first_of([t for t in trials if t.case[:2] == group])
        centroid, nearest = np.median(ranking[0].centroid_m), np.median(ranking[0].nearest_m)
        table = table_of(ranking)
        parts += [
            f"### {group[0]:g} m, {group[1]} neighbours",
            f"Median errors without a map: centroid {centroid:.3f} m, nearest place {nearest:.3f} m.",
            markdown({name: table[name] for name in shown}),
        ]
    return "\n\n".join(parts)
