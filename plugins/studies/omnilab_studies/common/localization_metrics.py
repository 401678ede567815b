"""Metrics of localisation: rates, errors, recall@N, precision and recall, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Ints, Metric, Places
from omnilab.metrics import (
    VERDICTS,
    average_precision,
    bootstrap,
    precision_recall,
    recall_at,
    recall_at_full_precision,
    resampled_curves,
)
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import UNDECIDED, ScoredEstimates

Statistic = Callable[[Ints], Floats]  # of each of R resamples, (R,), by indices of queries (R, Q)
SHOWN_RANKS = (1, 5, 10)
METRIC_NAMES = (  # of localisation in a map, those that every run has first
    *(f"{verdict}_rate" for verdict in VERDICTS), "position_error_median", "position_error_mean", "position_error_p95",
    "heading_error_median", "heading_error_mean", "heading_error_p95", "position_error_steps_median", "within_step_rate",
    *(f"recall_at_{n}" for n in SHOWN_RANKS), "recall_at_1_percent", "average_precision", "recall_at_full_precision",
    "queries", "queries_without_place", "sharpness_mean", "places", "left_out", "bytes_per_place",
)  # fmt: skip


def localization_metrics(
    scored: ScoredEstimates, place_count: int, step_m: float, rng: np.random.Generator
) -> list[Metric]:
    """Rates, errors, recall and precision of the estimates on a map of `place_count` places, `step_m` apart.

    Each with a 95 % interval by bootstrap over the queries. True places of a query are those within one step. A query
    without any does not count for recall; an estimate accepted for it lowers precision. An estimate that is not decided
    counts as the worst of the places that are as near, is within no step, and has no heading error.
    """
    count = len(scored.place)
    found = []
    for name, unit, statistic in _statistics(scored, place_count, step_m):
        value = float(statistic(np.arange(count)[None])[0])
        interval = bootstrap(statistic, count, rng, vectorized=True)
        found.append(Metric(name, value, unit, interval, _note(scored, name)))
    without = Metric("queries_without_place", int((~scored.known).sum()), "1")
    return [*found, Metric("queries", count, "1"), without]


def _statistics(scored: ScoredEstimates, place_count: int, step_m: float) -> Iterator[tuple[str, str, Statistic]]:
    """Name, unit and definition of each."""
    for verdict in VERDICTS:
        yield f"{verdict}_rate", "1", _mean(scored.verdict == verdict)
    yield from _spread("position_error", scored.error_m, "m")
    if scored.has_headings:
        yield from _spread("heading_error", scored.heading_error_deg, "deg")
    if np.isfinite(step_m):
        yield "position_error_steps_median", "steps", _median(scored.error_m / step_m)
        yield "within_step_rate", "1", _mean((scored.error_m <= step_m) & scored.decided)
    for name, n in recalled(scored, place_count).items():
        yield name, "1", partial(_recall_at, true_ranks(scored), n)
    yield "average_precision", "1", partial(_of_curve, average_precision, scored)
    yield "recall_at_full_precision", "1", partial(_of_curve, recall_at_full_precision, scored)


def recalled(scored: ScoredEstimates, place_count: int) -> dict[str, int]:
    """Names of the recalls that can be computed, and N of each: without all distances, that of the estimate alone."""
    if not scored.has_ranks:
        return {"recall_at_1": 1}
    named = {f"recall_at_{n}": n for n in SHOWN_RANKS if n < place_count}
    return named | {"recall_at_1_percent": -(-place_count // 100)}


def true_ranks(scored: ScoredEstimates) -> Ints:
    """The rank (Q,) of the first true place, 0 for a query without one; without all distances, 1 if the estimate is
    true, or 2."""
    found = scored.true_rank if scored.has_ranks else np.where(scored.correct, 1, 2)
    return np.where(_judged(scored), found, 0)


def curve(scored: ScoredEstimates) -> tuple[Floats, Floats]:
    """Precision and recall (K,) as estimates are accepted, the most certain first."""
    return precision_recall(scored.distance, scored.correct, _judged(scored))[:2]


def _judged(scored: ScoredEstimates) -> Bools:
    """The queries (Q,) that recall counts: those with a true place; none where every place is true for all of them."""
    return scored.known & scored.confusable.any()


def _note(scored: ScoredEstimates, name: str) -> str:
    """Why a metric has no value, if it has none."""
    if name.startswith("heading_error"):
        return UNDECIDED
    if not scored.known.any():
        return "no query has a place of the map within one step"
    return "every place of the map is within one step of every query"


def _recall_at(ranks: Ints, n: int, chosen: Ints) -> Floats:
    return recall_at(ranks[chosen], n)


def _of_curve(statistic: Callable[[Floats, Floats], float], scored: ScoredEstimates, chosen: Ints) -> Floats:
    curves = resampled_curves(scored.distance, scored.correct, _judged(scored), chosen)
    return np.array([statistic(*each) for each in curves])


def _spread(name: str, values: Floats, unit: str) -> Iterator[tuple[str, str, Statistic]]:
    yield f"{name}_median", unit, _median(values)
    yield f"{name}_mean", unit, _mean(values)
    yield f"{name}_p95", unit, partial(_of, partial(np.quantile, q=0.95), values)


def _mean(values: Any) -> Statistic:
    return partial(_of, np.mean, values)


def _median(values: Floats) -> Statistic:
    return partial(_of, np.median, values)


def _of(statistic: Callable[..., Any], values: Floats, chosen: Ints) -> Floats:
    if np.isfinite(values).all():
        return np.asarray(statistic(values[chosen], axis=1))
    return np.array([of_known(statistic, drawn) for drawn in values[chosen]])


def map_metrics(places: Places, scored: ScoredEstimates, omitted: int) -> list[Metric]:
    """Sharpness C of a map's distances (thesis, eq. 4.6), mean over the queries, and the map's size."""
    found = [Metric("sharpness_mean", float(scored.sharpness.mean()), "1")] if scored.has_ranks else []
    size = places.signatures.nbytes / len(places)
    return [
        *found,
        Metric("places", len(places), "1"),
        Metric("left_out", omitted, "1"),
        Metric("bytes_per_place", size, "B"),
    ]
