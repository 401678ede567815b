"""Sets of places that hold the truth with a given confidence, by conformal prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats

SLACK = 1e-9


def nonconformity(field: Floats) -> Floats:
    """How much less alike each place is than the best, (Q, P): (d - min) / (median - min), 0 where all are equal."""
    above = field - field.min(axis=1, keepdims=True)
    middling = np.median(above, axis=1, keepdims=True)
    return np.where(above > 0, above / np.maximum(middling, np.finfo(np.float32).tiny), 0.0)


def true_places(truth_m: Floats, places_m: Floats, step_m: float) -> Bools:
    """The places (Q, P) within a step of the one that is nearest to each true position (Q, 3): the truth of a set."""
    away = np.linalg.norm(truth_m[:, None] - places_m[None], axis=2)
    nearest = places_m[away.argmin(axis=1)]
    return np.asarray(np.linalg.norm(nearest[:, None] - places_m[None], axis=2) <= step_m * (1 + SLACK))


def threshold(score: Floats, true: Bools, confidence: float) -> float:
    """The largest nonconformity that a set takes in, from scores (n, P) and true places (n, P) of a calibration.

    The ceil((n + 1) confidence)-th smallest of what each set needs to hold a true place (Vovk et al., 2005; Angelopoulos &
    Bates, 2023, 1.1); infinite, so that sets are the whole map, for fewer than confidence / (1 - confidence) of them.
    """
    needed = np.sort(np.where(true, score, np.inf).min(axis=1))
    rank = int(np.ceil((len(needed) + 1) * confidence - SLACK))
    return float(needed[rank - 1]) if rank <= len(needed) else float("inf")


def left_out(between: Floats, places_m: Floats, step_m: float) -> tuple[Floats, Bools]:
    """Each place of a map left out in turn and localised in the rest: scores (P, P - 1), and the true places of each.

    `between` (P, P) are the distances of the signatures of all places. With its neighbours a step away a place is harder to
    find than a query half-way between two: sets that are calibrated by it are rather too large than too small.
    """
    count = len(places_m)
    others = np.array([np.delete(np.arange(count), i) for i in range(count)])
    score = nonconformity(np.take_along_axis(between, others, axis=1))
    true = np.array([true_places(places_m[i : i + 1], places_m[rest], step_m)[0] for i, rest in enumerate(others)])
    return score, true


@dataclass(frozen=True)
class PlaceSets:
    """Sets of places for Q queries."""

    member: Bools  # (Q, P)
    extent_m: Floats  # (Q,) how far from its best place each set reaches
    elsewhere_m: float  # places of a set that are farther than this from its best are elsewhere

    @property
    def size(self) -> Floats:
        """How many places each set holds."""
        return np.asarray(self.member.sum(axis=1))

    @property
    def ambiguous(self) -> Bools:
        """Whether the set holds places elsewhere: the images do not tell which of them it is."""
        return np.asarray(self.extent_m > self.elsewhere_m)


def place_sets(field: Floats, largest: float, places_m: Floats, elsewhere_m: float) -> PlaceSets:
    """The sets of all places whose nonconformity is at most `largest`, from the distances (Q, P) to places (P, 3)."""
    member = nonconformity(field) <= largest
    away = np.linalg.norm(places_m[field.argmin(axis=1)][:, None] - places_m[None], axis=2)
    return PlaceSets(member, np.where(member, away, 0.0).max(axis=1), elsewhere_m)
