"""Estimates scored against the truth: one row per query."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Estimates, Floats, Frames, Ints
from omnilab.errors import DataError
from omnilab.geometry import heading_of
from omnilab.metrics import TIE_M, distances_to, first_ranks, heading_error, ranks, sharpness, verdicts


@dataclass(frozen=True)
class ScoredEstimates:
    """The estimates for Q queries beside the truth. What a localizer does not give is NaN, a rank is then 0."""

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
    correct: Bools  # (Q,) whether the estimated place is one of those
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
        """Heading errors (Q,) in [0, 180] degrees."""
        return np.rad2deg(heading_error(heading_of(self.truth), self.answer_heading_rad))

    @property
    def has_ranks(self) -> bool:
        """Whether the localizer gave all distances, by which places are ranked."""
        return bool((self.rank > 0).all())

    @property
    def has_headings(self) -> bool:
        """Whether the localizer gave all headings."""
        return bool(np.isfinite(self.answer_heading_rad).all())


def score(frames: Frames, estimates: Estimates, places_m: Floats, radius_m: float) -> ScoredEstimates:
    """Score a localizer's estimates against the poses of the frames, on a map of places (P, 3).

    All places within `radius_m` of a query are true ones, which recall is computed from.
    """
    truth = known_poses(frames.T_world_camera, "queries")
    unknown = np.full(len(frames), np.nan)
    to_places = distances_to(truth[:, :3, 3], places_m)
    true = to_places <= radius_m + TIE_M
    field, heading = estimates.field, estimates.heading_rad
    return ScoredEstimates(
        plan_index=frames.plan_index,
        stamps_ns=frames.stamps_ns,
        truth=truth,
        place=estimates.place,
        answer_m=estimates.position_m,
        answer_heading_rad=unknown if heading is None else heading,
        distance=estimates.distance,
        verdict=verdicts(to_places, estimates.place),
        rank=np.zeros(len(frames), int) if field is None else ranks(to_places, field),
        known=np.asarray(true.any(axis=1)),
        correct=true[np.arange(len(frames)), estimates.place],
        true_rank=np.zeros(len(frames), int) if field is None else first_ranks(field, true),
        sharpness=unknown if field is None else sharpness(field),
    )


def known_poses(T_world_camera: Floats | None, what: str) -> Floats:
    """The poses, or a DataError if the sensor does not know them."""
    if T_world_camera is None:
        raise DataError(f"the {what} have no positions, and this study scores positions; give a positions file")
    return T_world_camera


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
