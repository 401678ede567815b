"""Localisation of queries in one map: batch by batch, scored, logged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from omnilab.api import (
    Answers,
    Array,
    Batch,
    Bytes,
    DistanceField,
    Estimate,
    Estimates,
    Floats,
    Frames,
    Ints,
    Parts,
    Places,
    Plan,
    Recorder,
    SequenceLocalizer,
    Series,
    Signatures,
    Tick,
)
from omnilab.geometry import heading_of
from omnilab.metrics import spacing
from omnilab_studies.common.describing import describe
from omnilab_studies.common.frames import at_once, deliver_queries
from omnilab_studies.common.logs import show_frame
from omnilab_studies.common.scores import Degeneracy, ScoredEstimates, joined_estimates, known_poses, score

EXAMPLE_M = (-2.239, -1.653)  # x, y: the query nearest to it has its distance surface drawn (thesis, figure 4.12)


@dataclass
class ExampleQuery:
    """The query nearest to the thesis's example, with its distances to all places (thesis, figure 4.12)."""

    field: Floats | None = None  # (P,)
    truth_m: Floats | None = None  # (3,)
    answer_m: Floats | None = None  # (3,)

    def update(self, truth_m: Floats, answer_m: Floats, field: Floats | None) -> None:
        """Take the nearest of some queries, true positions and answers (Q, 3), if it is nearer than the one so far."""
        if field is None:
            return
        away = np.linalg.norm(truth_m[:, :2] - EXAMPLE_M, axis=1)
        best = int(away.argmin())
        if self.truth_m is None or away[best] < np.linalg.norm(self.truth_m[:2] - EXAMPLE_M):
            self.field, self.truth_m, self.answer_m = field[best], truth_m[best], answer_m[best]

    @property
    def batch(self) -> dict[str, Array]:
        """Itself, as arrays of one row; none if there is no such query."""
        if self.field is None or self.truth_m is None or self.answer_m is None:
            return {}
        return {
            "example_field": self.field[None],
            "example_truth_m": self.truth_m[None],
            "example_answer_m": self.answer_m[None],
        }


@dataclass
class LocalizationRun:
    """A prepared map in which queries are localised. Logs images of about `show` queries, and errors of all."""

    parts: Parts
    places: Places
    record: Recorder
    show: int
    omitted: list[str] = field(default_factory=list)  # queries that could not be delivered, with reasons
    example: ExampleQuery = field(default_factory=ExampleQuery)

    def __post_init__(self) -> None:
        self.places_m = known_poses(self.places.T_world_camera, "places")[:, :3, 3]
        self.step_m = spacing(self.places_m)
        self._degeneracy = Degeneracy(self.places)
        self._degeneracy.log_map(self.record)
        if self.parts.shards.merges:
            return
        with self.record.timed("prepare the map"):
            self._index = self.parts.localizer.prepare(self.places, self.parts.distance)

    def locate(self, signatures: Signatures, motion: Floats | None = None) -> Estimates:
        """The localizer's estimates; a sequence localizer gets the motion (Q, 3) up to each query where it is known."""
        localizer = self.parts.localizer
        if motion is not None and isinstance(localizer, SequenceLocalizer):
            return localizer.track(signatures, self._index, motion)
        return localizer.locate(signatures, self._index)

    def score(self, frames: Frames, signatures: Signatures, estimates: Estimates) -> ScoredEstimates:
        """A batch's estimates beside the truth."""
        scored = score(frames, estimates, self.places_m, self.step_m, self._degeneracy.alike)
        self._degeneracy.add(signatures, scored)
        return scored

    def log_degeneracy(self) -> None:
        """Warnings of what is degenerate in the queries so far, into the logs."""
        self._degeneracy.log_queries(self.record)

    def localize(self, plan: Plan, seed: int, motion: Floats | None = None) -> ScoredEstimates:
        """Localise all frames of a plan of queries, in order; `seed` is that of the disturbances."""

        def compute(first: int, last: int) -> Iterator[Batch]:
            return self._located(plan, (first, last), seed, motion)

        batches: list[ScoredEstimates] = []
        for batch in self.parts.shards.work("queries", len(plan), compute, at_once(self.parts)):
            self._degeneracy.count(batch)
            if "place" in batch:
                batches.append(ScoredEstimates(**{each.name: batch[each.name] for each in fields(ScoredEstimates)}))
                self._log_errors(batches[-1])
            if "omitted" in batch:
                self.omitted += batch["omitted"].tolist()
            if "example_field" in batch:
                self.example.update(*(batch[f"example_{name}"] for name in ("truth_m", "answer_m", "field")))
        scored = joined_estimates(batches)
        self.log_degeneracy()
        self.record.log("answers", Answers(scored.truth_m, scored.answer_m, list(scored.verdict)))
        return scored

    def _located(
        self, plan: Plan, share: tuple[int, int], seed: int, motion: Floats | None
    ) -> Iterator[dict[str, Array]]:
        """A share of the queries: of each batch what `ScoredEstimates` holds and what is degenerate, then the example."""
        example = ExampleQuery()
        for frames in deliver_queries(self.parts, plan, self.record, seed, share):
            signatures = describe(self.parts.descriptor, frames, self.record)
            with self.record.timed("localise", len(frames)):
                estimates = self.locate(signatures, None if motion is None else motion[frames.plan_index])
            scored = score(frames, estimates, self.places_m, self.step_m, self._degeneracy.alike)
            example.update(scored.truth_m, scored.answer_m, estimates.field)
            self._show(frames, signatures, scored, estimates.field, len(plan))
            yield (
                vars(scored)
                | self._degeneracy.look_at(signatures, scored)
                | {"omitted": np.array(frames.omitted, np.str_)}
            )
        yield example.batch

    def _log_errors(self, scored: ScoredEstimates) -> None:
        """Errors of every query."""
        steps, stamps = scored.plan_index, scored.stamps_ns
        self.record.log("error/position_m", Series(scored.error_m, steps, stamps, "m"))
        if scored.has_headings:
            own = scored.decided
            errors = Series(scored.heading_error_deg[own], steps[own], stamps[own], "deg")
            self.record.log("error/heading_deg", errors)

    def _show(
        self, frames: Frames, signatures: Signatures, scored: ScoredEstimates, field: Floats | None, total: int
    ) -> None:
        """Images of some queries."""
        steps, stamps = scored.plan_index, scored.stamps_ns
        every = max(1, -(-total // self.show)) if self.show > 0 else total + 1
        for i in np.flatnonzero((steps + 1) % every == 0):
            tick = Tick(int(steps[i]), int(stamps[i]))
            show_frame(self.record, frames, int(i), signatures.place[i], tick)
            if field is not None:
                self.record.log("distances", DistanceField(self.places_m, field[i]), tick)
            self.record.log("estimate", estimate_of(scored, int(i)), tick)

    def pictures(self, places: Ints) -> Bytes:
        """The images of places (N,), taken anew by the run's sensor: a map keeps none."""
        plan = Plan(self.places.keys, self.places.T_world_camera).at(places)
        return np.concatenate([frames.images for frames in self.parts.sensor.frames(plan)])


def estimate_of(scored: ScoredEstimates, i: int) -> Estimate:
    """The estimate of query i, for the logs."""
    heading = float(scored.answer_heading_rad[i])
    return Estimate(
        scored.truth_m[i], scored.answer_m[i], str(scored.verdict[i]),
        float(heading_of(scored.truth[i])), heading if np.isfinite(heading) else None,
    )  # fmt: skip


def answer_row(step: int, key: str, estimates: Estimates, i: int) -> dict[str, Any]:
    """The estimate of query i as a row of `answers.csv`."""
    x, y, z = estimates.position_m[i].tolist()
    heading = np.nan if estimates.heading_rad is None else float(np.rad2deg(estimates.heading_rad[i]))
    return {
        "query": step, "key": key, "place": int(estimates.place[i]), "answer_x_m": x, "answer_y_m": y, "answer_z_m": z,
        "answer_heading_deg": heading, "distance": float(estimates.distance[i]),
    }  # fmt: skip
