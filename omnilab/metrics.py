"""Measures of localisation, each with its definition."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints
from omnilab.geometry import wrap_angle

TIE_M = 1e-3  # places this much farther than the nearest one are as near
SPACING_SAMPLES = 1000
VERDICTS = ("nearest", "second", "wrong")


def distances_to(truth_m: Floats, places_m: Floats) -> Floats:
    """Metric distances (Q, P) from where queries were taken (Q, 3) to the places (P, 3)."""
    return np.asarray(np.linalg.norm(truth_m[:, None, :] - places_m[None, :, :], axis=-1))


def verdicts(distance_m: Floats, answer: Ints) -> npt.NDArray[np.str_]:
    """Score answers (Q,), indices of places, by the metric distances (Q, P) to all places (thesis, 4.5.1).

    "nearest": no place is more than 1 mm closer to the query than the answered one (half-way queries have several
    nearest places); "second": the answer is at the next distinct distance; "wrong": any other.
    """
    answered = distance_m[np.arange(len(answer)), answer]
    nearest = distance_m.min(axis=1)
    second = np.where(distance_m > nearest[:, None] + TIE_M, distance_m, np.inf).min(axis=1)
    return np.where(answered <= nearest + TIE_M, "nearest", np.where(answered <= second + TIE_M, "second", "wrong"))


def ranks(distance_m: Floats, field: Floats) -> Ints:
    """At which rank (Q,), from 1, the first of the truly nearest places comes when places are sorted by `field` (Q, P)."""
    nearest = distance_m <= distance_m.min(axis=1, keepdims=True) + TIE_M
    best = np.where(nearest, field, np.inf).min(axis=1)
    return 1 + np.asarray((field < best[:, None]).sum(axis=1))


def sharpness(field: Floats) -> Floats:
    """C = (mean - min) / (max - min) of the distances (Q, P) of each query to the map (thesis, eq. 4.6), (Q,).

    1: only the answer is near. 0 (by definition here) where all places are equally far.
    """
    low, high = field.min(axis=1), field.max(axis=1)
    spread = high - low
    return np.asarray(np.divide(field.mean(axis=1) - low, spread, out=np.zeros_like(low), where=spread > 0))


def heading_error(truth_rad: Floats, answer_rad: Floats) -> Floats:
    """Absolute angle between headings, in [0, pi]."""
    return np.abs(wrap_angle(answer_rad - truth_rad))


def spacing(places_m: Floats) -> float:
    """The step of a map: the median distance from its places (P, 3) to their nearest others; NaN for a single place.

    Of a thousand places, evenly chosen, where there are more.
    """
    if len(places_m) < 2:
        return float("nan")
    some = np.unique(np.linspace(0, len(places_m) - 1, SPACING_SAMPLES).astype(int))
    return float(np.median([np.partition(((places_m - places_m[i]) ** 2).sum(axis=1), 1)[1] for i in some]) ** 0.5)


def first_ranks(field: Floats, true: npt.NDArray[np.bool_]) -> Ints:
    """At which rank (Q,), from 1, the first true place (Q, P) comes when places are sorted by `field` (Q, P); 0 if none is.

    Of places that are equally far the true one comes last, so that a constant field finds nothing.
    """
    best = np.where(true, field, np.inf).min(axis=1)
    return np.where(true.any(axis=1), 1 + ((field <= best[:, None]) & ~true).sum(axis=1), 0)


def recall_at(ranks: Ints, n: int) -> float:
    """Share of the queries with a true place (rank above 0) of which one is among the first n; NaN if there is no such query."""
    known = ranks[ranks > 0]
    return float((known <= n).mean()) if len(known) else float("nan")


def precision_recall(
    distance: Floats, correct: npt.NDArray[np.bool_], known: npt.NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats]:
    """Precision, recall and threshold (K,) as answers (Q,) are accepted up to a growing distance (Q,).

    An accepted answer is a true positive if it is `correct`, else a false one: also where the query has no true place at
    all (`known` is false), which no recall counts. Answers at the same distance are accepted together.
    """
    order = np.argsort(distance, kind="stable")
    ends = np.flatnonzero(np.diff(distance[order], append=np.inf) > 0)
    positives = np.cumsum(correct[order])[ends]
    recall = positives / known.sum() if known.any() else np.full(len(ends), np.nan)
    return positives / (ends + 1), recall, distance[order][ends]


def average_precision(precision: Floats, recall: Floats) -> float:
    """Area under the curve of precision (K,) over recall (K,), each step at its own precision: no interpolation flatters it."""
    return float(np.sum(np.diff(recall, prepend=0) * precision))


def recall_at_full_precision(precision: Floats, recall: Floats) -> float:
    """The highest recall (K,) at which no accepted answer is wrong (K,); 0 if the most certain one is."""
    return float(np.max(recall[precision == 1], initial=0))


def bootstrap(
    statistic: Callable[[Ints], float], count: int, rng: np.random.Generator, resamples: int = 1000
) -> tuple[float, float]:
    """95 % interval of a statistic of `count` observations: percentiles over resamples with replacement (Efron, 1979).

    `statistic` takes indices of observations; resamples of which it is NaN do not count.
    """
    found = [statistic(rng.integers(count, size=count)) for _ in range(resamples)]
    low, high = np.nanquantile(found, [0.025, 0.975]) if np.isfinite(found).any() else (np.nan, np.nan)
    return float(low), float(high)
