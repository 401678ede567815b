"""Estimates scored against the truth, one row per query; and maps and queries that no method can be judged by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Array, Bools, Estimates, Floats, Frames, Ints, Places, Recorder, Signatures, Text
from omnilab.errors import DataError
from omnilab.geometry import heading_of
from omnilab.metrics import (
    TIE_M,
    distances_to,
    equal,
    first_alike,
    first_ranks,
    heading_error,
    is_flat,
    ranks,
    sharpness,
    tie_distance,
    verdicts,
)

UNDECIDED = "nothing tells any answer from other places"  # why there is no heading error


@dataclass(frozen=True)
class ScoredEstimates:
    """The estimates for Q queries beside the truth. What a localizer does not give is NaN, a rank is then 0.

    Where nothing tells the estimated place from others that are elsewhere, it is one of them by chance: the estimate is
    not `decided`, counts as the worst of them, and has no heading error.
    """

    plan_index: Ints  # (Q,) in the plan of queries
    stamps_ns: Ints  # (Q,)
    truth: Floats  # (Q, 4, 4) T_world_camera
    place: Ints  # (Q,) the estimated place
    answer_m: Floats  # (Q, 3)
    answer_heading_rad: Floats  # (Q,)
    distance: Floats  # (Q,) to the estimated place
    verdict: npt.NDArray[np.str_]  # (Q,)
    rank: Ints  # (Q,) of the truly nearest place, from 1
    known: Bools  # (Q,) whether a place of the map is within the radius: the query has a true place
    confusable: Bools  # (Q,) whether another is not within it: there is something to be confused with
    correct: Bools  # (Q,) whether the estimated place is one of those
    decided: Bools  # (Q,) whether it is told from all places elsewhere
    true_rank: Ints  # (Q,) of the first place within it
    sharpness: Floats  # (Q,) C of the distances to all places (thesis, eq. 4.6)

    @property
    def truth_m(self) -> Floats:
        """True positions (Q, 3)."""
        return self.truth[:, :3, 3]

    @property
    def error_m(self) -> Floats:
        """Position errors (Q,)."""
        return np.asarray(np.linalg.norm(self.answer_m - self.truth_m, axis=1))

    @property
    def heading_error_deg(self) -> Floats:
        """Heading errors (Q,) in [0, 180] degrees; NaN where the estimate is not decided."""
        error = np.rad2deg(heading_error(heading_of(self.truth), self.answer_heading_rad))
        return np.where(self.decided, error, np.nan)

    @property
    def has_ranks(self) -> bool:
        """Whether the localizer gave all distances, by which places are ranked."""
        return bool((self.rank > 0).all())

    @property
    def has_headings(self) -> bool:
        """Whether the localizer gave all headings."""
        return bool(np.isfinite(self.answer_heading_rad).all())


def score(
    frames: Frames, estimates: Estimates, places_m: Floats, radius_m: float, alike: Ints | None = None
) -> ScoredEstimates:
    """Score a localizer's estimates against the poses of the frames, on a map of places (P, 3).

    All places within `radius_m`, the map's step, of a query are true ones, which recall is computed from. Places of one
    number in `alike` (P,) have one signature, and none is told from another where a query is equally far from all.
    DataError for a map of one place, in which every answer would be right.
    """
    check_apart(places_m, radius_m)
    truth = known_poses(frames.T_world_camera, "queries")
    unknown, tie_m = np.full(len(frames), np.nan), tie_distance(radius_m)
    to_places = distances_to(truth[:, :3, 3], places_m)
    true = to_places <= radius_m + tie_m
    field, heading, place = estimates.field, estimates.heading_rad, estimates.place
    or_these = np.zeros_like(true) if alike is None else alike[None, :] == alike[place][:, None]
    or_these[np.arange(len(frames)), place] = True
    if field is not None:
        or_these[is_flat(field)] = True
    return ScoredEstimates(
        plan_index=frames.plan_index,
        stamps_ns=frames.stamps_ns,
        truth=truth,
        place=place,
        answer_m=estimates.position_m,
        answer_heading_rad=unknown if heading is None else heading,
        distance=estimates.distance,
        verdict=verdicts(to_places, place, tie_m, or_these),
        rank=np.zeros(len(frames), int) if field is None else ranks(to_places, field, tie_m),
        known=np.asarray(true.any(axis=1)),
        confusable=np.asarray(~true.all(axis=1)),
        correct=np.asarray((true | ~or_these).all(axis=1)),
        decided=_decided(or_these, place, places_m, tie_m),
        true_rank=np.zeros(len(frames), int) if field is None else first_ranks(field, true),
        sharpness=unknown if field is None else sharpness(field),
    )


def check_apart(places_m: Floats, step_m: float) -> None:
    """DataError if all places (P, 3) of a map, with that `omnilab.metrics.spacing`, are one."""
    if not np.isfinite(step_m) or (step_m < TIE_M and np.linalg.norm(np.ptp(places_m, axis=0)) <= TIE_M):
        raise DataError(
            f"all places of the map ({len(places_m)}) are at one position, so that every answer would be right; give places"
            " that are apart: a smaller step, a larger area, or more images"
        )


def _decided(or_these: Bools, place: Ints, places_m: Floats, tie_m: float) -> Bools:
    """Which queries (Q,) could only have been answered with places (Q, P) where the estimated one is."""
    decided = np.ones(len(place), bool)
    for q in np.flatnonzero(or_these.sum(axis=1) > 1):
        apart_m = np.linalg.norm(places_m[or_these[q]] - places_m[place[q]], axis=1)
        decided[q] = apart_m.max() <= tie_m
    return decided


def known_poses(T_world_camera: Floats | None, what: str) -> Floats:
    """The poses, or a DataError if the sensor does not know them."""
    if T_world_camera is None:
        raise DataError(f"the {what} have no positions, and this study scores positions; give a positions file")
    return T_world_camera


class Degeneracy:
    """What is degenerate in a map, and in the queries that are localised in it: warnings, in sentences.

    Signatures are equal if every number of them is.
    """

    def __init__(self, places: Places, name: str = "") -> None:
        self._places, self._name = places, name  # that of the descriptor, where there are several
        self.alike = first_alike(places.signatures)  # (P,)
        self._all_alike = len(self.alike) > 1 and not self.alike.any()
        self._first: Signatures | None = None  # of the queries
        self._queries = self._of_map = self._undecided = 0
        self._all_equal = True  # are the queries so far

    def add(self, signatures: Signatures, scored: ScoredEstimates) -> None:
        """Take note of a batch of queries."""
        self.count(self.look_at(signatures, scored))

    def look_at(self, signatures: Signatures, scored: ScoredEstimates) -> dict[str, Array]:
        """What there is to note of a batch of queries, as arrays that can be kept and joined."""
        if not len(signatures):
            return {}
        first, answered = signatures[:1], self._places.signatures[scored.place]
        found: dict[str, Array] = {
            "first_place": first.place,
            "like_first": equal(signatures, first[np.zeros(len(signatures), int)]),
            "of_map": equal(signatures, answered),
            "undecided": ~scored.decided,
        }
        return found if first.heading is None else found | {"first_heading": first.heading}

    def count(self, seen: Mapping[str, Array]) -> None:
        """Take note of what `look_at` found, in one batch or in several that were joined."""
        if "of_map" not in seen:
            return
        firsts = Signatures(seen["first_place"], seen.get("first_heading"))
        self._first = firsts[:1] if self._first is None else self._first
        self._all_equal &= bool(
            seen["like_first"].all() and equal(firsts, self._first[np.zeros(len(firsts), int)]).all()
        )
        self._queries += len(seen["of_map"])
        self._of_map += int(seen["of_map"].sum())
        self._undecided += int(seen["undecided"].sum())

    def map_warnings(self) -> list[str]:
        """On the map."""
        found = equal_signatures(self._places.signatures, self._places.keys, "places of the map")
        if self._all_alike:
            return [
                f"{found[0]}: no answer is better than another, so that none counts as right, and headings are left out"
            ]
        return [f"{sentence}: an answer that could as well be another counts as the worse" for sentence in found]

    def query_warnings(self) -> list[str]:
        """On the queries so far."""
        found = []
        if self._queries > 1 and self._all_equal:
            found.append(
                f"all {self._queries} queries have equal signatures, as black or constant pictures have: they get one answer"
            )
        elif self._undecided and not self._all_alike:
            found.append(
                f"{self._undecided} of {self._queries} queries have answers that nothing tells from places elsewhere: each"
                " counts as the worst of these, and has no heading"
            )
        if self._of_map and not self._all_alike:
            found.append(
                f"{self._of_map} of {self._queries} queries have exactly the signature of the place that answers them, as"
                " pictures of the map itself have: to find these again is no achievement; give queries that were taken apart"
            )
        return found

    def log_map(self, record: Recorder) -> None:
        """Warnings on the map, into the logs."""
        self._log(record, self.map_warnings())

    def log_queries(self, record: Recorder) -> None:
        """Warnings on the queries, into the logs."""
        self._log(record, self.query_warnings())

    def _log(self, record: Recorder, sentences: list[str]) -> None:
        for sentence in sentences:
            record.log("log", Text(f"{self._name}: {sentence}" if self._name else sentence, "WARN"))


def equal_signatures(signatures: Signatures, keys: Sequence[str], what: str) -> list[str]:
    """A sentence if images have equal signatures, as copies of a picture and black ones have; none if all differ.

    `keys` name the images, `what` says what they are.
    """
    alike = first_alike(signatures)
    again = np.flatnonzero(alike != np.arange(len(alike)))
    if not len(again):
        return []
    if not alike.any():
        return [f"all {len(keys)} {what} have equal signatures, as black or constant pictures have"]
    pair = f"{keys[alike[again[0]]]} and {keys[again[0]]}"
    copies = f"{len(again)} of {len(keys)} {what} have the signature of one before, as copies of a picture or black ones have"
    return [f"{copies} (the first: {pair})"]


def warn_of_equal_signatures(
    signatures: Mapping[str, Signatures], keys: Sequence[str], what: str, record: Recorder
) -> None:
    """The sentence of each descriptor's signatures, into the logs, where a study has no answers to count as the worse."""
    for name, described in signatures.items():
        for sentence in equal_signatures(described, keys, what):
            record.log("log", Text(f"{name}: {sentence}; their distances are 0, which no comparison can rank", "WARN"))


def joined_estimates(batches: Sequence[ScoredEstimates]) -> ScoredEstimates:
    """Batches concatenated; DataError if there was no query at all."""
    if not batches:
        raise DataError("the sensor delivered no queries for the study's layout; ask for other query poses")
    return ScoredEstimates(*(np.concatenate([getattr(b, f.name) for b in batches]) for f in fields(ScoredEstimates)))


def query_table(scored: ScoredEstimates, keys: Sequence[str]) -> Mapping[str, Sequence[Any]]:
    """The table `queries` of a report, written as `queries.csv`: a row per query with truth, answer, errors and ranks.

    `keys` are those of the queries' plan.
    """
    truth, answer = scored.truth_m, scored.answer_m
    columns: dict[str, Any] = {
        "query": scored.plan_index,
        "key": [keys[i] for i in scored.plan_index],
        **{f"truth_{axis}_m": truth[:, i] for i, axis in enumerate("xyz")},
        "truth_heading_deg": np.rad2deg(heading_of(scored.truth)),
        "place": scored.place,
        **{f"answer_{axis}_m": answer[:, i] for i, axis in enumerate("xyz")},
        "answer_heading_deg": np.rad2deg(scored.answer_heading_rad),
        "error_m": scored.error_m,
        "heading_error_deg": scored.heading_error_deg,
        "verdict": scored.verdict,
        "rank": scored.rank,
        "has_true_place": scored.known,
        "true_rank": scored.true_rank,
        "distance": scored.distance,
        "sharpness": scored.sharpness,
    }
    return {name: np.asarray(column).tolist() for name, column in columns.items()}
