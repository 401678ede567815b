"""Measures of localisation, each with its definition."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Array, Bools, Floats, Ints, Signatures
from omnilab.geometry import wrap_angle

TIE_M = 1e-3  # places this much farther than the nearest one are as near, in maps of rooms: see `tie_distance`
FINEST, COARSEST = 1 / 50, 1 / 2000  # of the spacing: ties are never wider, never narrower
SAME = 1e-12  # of the largest coordinate: positions closer than that are one
ROUNDING = 1e-6  # of the largest: distances that differ by less are equal but for rounding
SPACING_SAMPLES = 1000
SAMPLED = 64  # numbers of a signature that are compared first
AT_ONCE = 1_000_000  # indices of resamples: 8 MB
VERDICTS = ("nearest", "second", "wrong")


def distances_to(truth_m: Floats, places_m: Floats) -> Floats:
    """Metric distances (Q, P) from where queries were taken (Q, 3) to the places (P, 3)."""
    return np.asarray(np.linalg.norm(truth_m[:, None, :] - places_m[None, :, :], axis=-1))


def tie_distance(spacing_m: float) -> float:
    """How much farther than the nearest place a place may be to count as as near, in a map of that `spacing`.

    A millimetre, but no more than 1/50 of the spacing and no less than 1/2000: so also in maps of a table or a town.
    """
    return float(min(max(TIE_M, COARSEST * spacing_m), FINEST * spacing_m)) if np.isfinite(spacing_m) else TIE_M


def is_flat(field: Floats) -> Bools:
    """Which queries (Q,) are equally far from all places, but for rounding, by their distances (Q, P)."""
    return np.asarray(np.ptp(field, axis=1) <= ROUNDING * np.abs(field).max(axis=1))


def verdicts(
    distance_m: Floats, answer: Ints, tie_m: float = TIE_M, or_these: Bools | None = None
) -> npt.NDArray[np.str_]:
    """Score answers (Q,), indices of places, by the metric distances (Q, P) to all places (thesis, 4.5.1).

    "nearest": no place is more than `tie_m` closer to the query than the answered one (half-way queries have several
    nearest places); "second": the answer is at the next distinct distance; "wrong": any other. Where there are places
    that could as well have been answered, since nothing tells them apart, `or_these` (Q, P), the worst is scored.
    """
    answered = distance_m[np.arange(len(answer)), answer]
    if or_these is not None:
        answered = np.where(or_these, distance_m, answered[:, None]).max(axis=1)
    nearest = distance_m.min(axis=1)
    second = np.where(distance_m > nearest[:, None] + tie_m, distance_m, np.inf).min(axis=1)
    return np.where(answered <= nearest + tie_m, "nearest", np.where(answered <= second + tie_m, "second", "wrong"))


def ranks(distance_m: Floats, field: Floats, tie_m: float = TIE_M) -> Ints:
    """At which rank (Q,), from 1, the first of the truly nearest places comes when places are sorted by `field` (Q, P).

    Others that are as far do not come before it, but where all are: then it comes last. NaN is the farthest.
    """
    nearest = distance_m <= distance_m.min(axis=1, keepdims=True) + tie_m
    field = np.where(np.isnan(field), np.inf, field)
    best = np.where(nearest, field, np.inf).min(axis=1)
    before = np.where((field == field[:, :1]).all(axis=1)[:, None], ~nearest, field < best[:, None])
    return 1 + np.asarray(before.sum(axis=1))


def sharpness(field: Floats) -> Floats:
    """C = (mean - min) / (max - min) of the distances (Q, P) of each query to the map (thesis, eq. 4.6), (Q,).

    1: only the answer is near. 0 (by definition here) where all places are equally far. NaN where a distance is.
    """
    low, high = field.min(axis=1), field.max(axis=1)
    spread = high - low
    return np.asarray(np.divide(field.mean(axis=1) - low, spread, out=np.zeros_like(low), where=spread > 0))


def middle(ordered: Sequence[float]) -> float:
    """The median of numbers in their order, as NumPy has it: a list that is kept by `bisect.insort` is not sorted again."""
    return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def heading_error(truth_rad: Floats, answer_rad: Floats) -> Floats:
    """Absolute angle between headings, in [0, pi]."""
    return np.abs(wrap_angle(answer_rad - truth_rad))


def spacing(places_m: Floats) -> float:
    """The step of a map: the median distance from its places (P, 3) to their nearest others; NaN for a single one.

    Of a thousand places, evenly chosen, where there are more. Places at one position are one.
    """
    if len(places_m) < 2:
        return float("nan")
    some = np.unique(np.linspace(0, len(places_m) - 1, SPACING_SAMPLES).astype(int))
    same = float(np.square(SAME * np.abs(places_m).max()))
    nearest = [_nearest_other(((places_m - places_m[i]) ** 2).sum(axis=1), same) for i in some]
    return float(np.median(nearest) ** 0.5)


def _nearest_other(square: Floats, same: float) -> float:
    """The least of squared distances (P,) above `same`; NaN if there is none."""
    return float(np.min(square, initial=np.inf, where=square > same)) if (square > same).any() else float("nan")


def first_ranks(field: Floats, true: Bools) -> Ints:
    """At which rank (Q,), from 1, the first true place (Q, P) comes when places are sorted by `field` (Q, P); 0 if none is.

    Of places that are equally far the true one comes last, so that a constant field finds nothing; a place whose distance
    is NaN is the farthest.
    """
    field = np.where(np.isnan(field), np.inf, field)
    best = np.where(true, field, np.inf).min(axis=1)
    return np.where(true.any(axis=1), 1 + ((field <= best[:, None]) & ~true).sum(axis=1), 0)


def recall_at(ranks: Ints, n: int) -> Floats:
    """Share (...) of the queries (..., Q) with a true place (rank above 0) of which one is among the first n.

    NaN where there is no such query.
    """
    known = ranks > 0
    found, count = (known & (ranks <= n)).sum(axis=-1), known.sum(axis=-1)
    return np.asarray(np.divide(found, count, out=np.full(count.shape, np.nan), where=count > 0))


def precision_recall(distance: Floats, correct: Bools, known: Bools) -> tuple[Floats, Floats, Floats]:
    """Precision, recall and threshold (K,) as answers (Q,) are accepted up to a growing distance (Q,).

    An accepted answer is a true positive if it is `correct`, else a false one: also where the query has no true place at
    all (`known` is false), which no recall counts. Answers at the same distance are accepted together, those at no finite
    one never.
    """
    order, ends = _nearest_first(distance)
    positives = np.cumsum(correct[order])[ends]
    recall = positives / known.sum() if known.any() else np.full(len(ends), np.nan)
    return positives / (ends + 1), recall, distance[order][ends]


def _nearest_first(distance: Floats) -> tuple[Ints, Ints]:
    """The answers at a finite distance (F,), nearest first, and where those that are equally near end among them (K,)."""
    order = np.argsort(distance, kind="stable")
    order = order[np.isfinite(distance[order])]
    return order, np.flatnonzero(np.diff(distance[order], append=np.inf) > 0)


def average_precision(precision: Floats, recall: Floats) -> float:
    """Area under the curve of precision (K,) over recall (K,), each step at its own precision: no interpolation flatters it."""
    return float(np.sum(np.diff(recall, prepend=0) * precision))


def recall_at_full_precision(precision: Floats, recall: Floats) -> float:
    """The highest recall (K,) at which no accepted answer is wrong (K,); 0 if the most certain one is, NaN as recall is."""
    return float(np.max(recall[precision == 1], initial=0)) if np.isfinite(recall).all() else float("nan")


def resampled_curves(distance: Floats, correct: Bools, known: Bools, chosen: Ints) -> Iterator[tuple[Floats, Floats]]:
    """Precision and recall (K,) by `precision_recall` of each of R resamples, indices (R, Q) of the answers.

    They are sorted once: a resample is how often each is drawn.
    """
    order, ends = _nearest_first(distance)
    count = len(distance)
    drawn = np.bincount((chosen + count * np.arange(len(chosen))[:, None]).ravel(), minlength=count * len(chosen))
    drawn = drawn.reshape(len(chosen), count)
    accepted = np.cumsum(drawn[:, order], axis=1)[:, ends]
    positives = np.cumsum(drawn[:, order] * correct[order], axis=1)[:, ends]
    new = np.diff(accepted, prepend=0, axis=1) > 0
    for row, all_known in enumerate(drawn @ known):
        right = positives[row, new[row]]
        yield right / accepted[row, new[row]], right / all_known if all_known else np.full(len(right), np.nan)


def bootstrap(
    statistic: Callable[[Ints], Any],
    count: int,
    rng: np.random.Generator,
    resamples: int = 1000,
    vectorized: bool = False,
) -> tuple[float, float]:
    """95 % interval of a statistic of `count` observations: percentiles over resamples with replacement (Efron, 1979).

    `statistic` takes indices (count,) of observations, or those (R, count) of R resamples if it is `vectorized`: then it
    returns an array (R,). Resamples of which it is NaN do not count. The interval is the same either way.
    """
    most = max(1, AT_ONCE // max(1, count)) if vectorized else 1
    found = list[float]()
    while (left := resamples - len(found)) > 0:
        chosen = rng.integers(count, size=(min(most, left), count))
        found += statistic(chosen).tolist() if vectorized else [statistic(chosen[0])]
    low, high = np.nanquantile(found, [0.025, 0.975]) if np.isfinite(found).any() else (np.nan, np.nan)
    return float(low), float(high)


# ---------------------------------------------------------------------------------------------------- equal signatures
def first_alike(signatures: Signatures) -> Ints:
    """For each signature (N,) the first that equals it: itself, if none before does."""
    first = np.arange(len(signatures))
    seen: dict[int, int] = {}
    for i, sample in enumerate(np.ascontiguousarray(_sampled(signatures.place))):
        j = seen.setdefault(hash(sample.tobytes()), i)
        if j < i and equal(signatures[i : i + 1], signatures[j : j + 1])[0]:
            first[i] = j
    return first


def equal(one: Signatures, other: Signatures) -> Bools:
    """Which of two times N signatures are equal in every number (N,)."""
    same = (_sampled(one.place) == _sampled(other.place)).all(axis=1)
    for pair in ((one.place, other.place), (one.heading, other.heading)):
        if pair[0] is not None and pair[1] is not None:
            for i in np.flatnonzero(same):
                same[i] = np.array_equal(pair[0][i], pair[1][i])
    return np.asarray(same)


def _sampled(values: Floats) -> Array:
    """Some numbers (N, about 64) of each of N signatures."""
    rows = values.reshape(len(values), -1)
    return rows[:, :: max(1, rows.shape[1] // SAMPLED)]
