"""Queries put to a localizer: answered batch by batch, scored, logged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import (
    Answers,
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
from omnilab_studies.common import plots
from omnilab_studies.common.describing import deliver_queries, describe, disturbed, show_frame
from omnilab_studies.common.recall import curve, true_ranks
from omnilab_studies.common.scores import Scored, joined, known_poses, score

EXAMPLE_M = (-2.239, -1.653)  # x, y: the query nearest to it has its distance surface drawn (thesis, figure 4.12)
WORST = 6  # wrong answers shown in a figure


@dataclass
class Example:
    """The query nearest to the thesis's example, with its distances to all places."""

    field: Floats | None = None  # (P,)
    truth_m: Floats | None = None  # (3,)
    answer_m: Floats | None = None  # (3,)

    def offer(self, scored: Scored, field: Floats | None) -> None:
        """Keep the best of a batch if it beats what there is."""
        if field is None:
            return
        away = np.linalg.norm(scored.truth_m[:, :2] - EXAMPLE_M, axis=1)
        best = int(away.argmin())
        if self.truth_m is None or away[best] < np.linalg.norm(self.truth_m[:2] - EXAMPLE_M):
            self.field, self.truth_m, self.answer_m = field[best], scored.truth_m[best], scored.answer_m[best]


@dataclass
class LocalizationRun:
    """A map ready to be asked, and how what it answers is shown: pictures of about `show` queries, numbers of all."""

    parts: Parts
    places: Places
    record: Recorder
    show: int
    omitted: list[str] = field(default_factory=list)  # queries that could not be delivered, with reasons
    example: Example = field(default_factory=Example)

    def __post_init__(self) -> None:
        self.places_m = known_poses(self.places.T_world_camera, "places")[:, :3, 3]
        self.step_m = spacing(self.places_m)
        with self.record.timed("prepare the map"):
            self._index = self.parts.localizer.prepare(self.places, self.parts.distance)

    def locate(self, signatures: Signatures, motion: Floats | None = None) -> Estimates:
        """What the localizer answers; a tracker is told the motion (Q, 3) up to each query where it is given."""
        localizer = self.parts.localizer
        if motion is not None and isinstance(localizer, SequenceLocalizer):
            return localizer.track(signatures, self._index, motion)
        return localizer.locate(signatures, self._index)

    def ask(self, plan: Plan, seed: int, motion: Floats | None = None) -> Scored:
        """The answers to all frames of a plan, in order."""
        batches: list[Scored] = []
        for frames in deliver_queries(self.parts, plan, self.record, seed):
            self.omitted += frames.omitted
            signatures = describe(self.parts.descriptor, frames, self.record)
            with self.record.timed("localise", len(frames)):
                estimates = self.locate(signatures, None if motion is None else motion[frames.plan_index])
            batches.append(score(frames, estimates, self.places_m, self.step_m))
            self.example.offer(batches[-1], estimates.field)
            self._log(frames, signatures, batches[-1], estimates.field, len(plan))
        scored = joined(batches)
        self.record.log("answers", Answers(scored.truth_m, scored.answer_m, list(scored.verdict)))
        return scored

    def _log(self, frames: Frames, signatures: Signatures, scored: Scored, field: Floats | None, total: int) -> None:
        """Numbers of every query, pictures of some."""
        steps, stamps = scored.plan_index, scored.stamps_ns
        self.record.log("error/position_m", Series(scored.error_m, steps, stamps, "m"))
        if scored.has_headings:
            self.record.log("error/heading_deg", Series(scored.heading_error_deg, steps, stamps, "deg"))
        every = max(1, -(-total // self.show)) if self.show > 0 else total + 1
        for i in np.flatnonzero((steps + 1) % every == 0):
            tick = Tick(int(steps[i]), int(stamps[i]))
            show_frame(self.record, frames, int(i), signatures.place[i], tick)
            if field is not None:
                self.record.log("distances", DistanceField(self.places_m, field[i]), tick)
            self.record.log("estimate", estimate_of(scored, int(i)), tick)

    def figures(self, scored: Scored) -> dict[str, Any]:
        """Success, errors on the floor plan, recall and precision, the distances of one query."""
        drawn = {
            "success": plots.success(scored.verdict),
            "error_map": plots.error_map(
                self.places_m, scored.truth_m, scored.answer_m, scored.error_m, scored.verdict
            ),
            "recall": plots.recall(true_ranks(scored), *curve(scored), len(self.places)),
        }
        example = self.example
        if example.field is not None and example.truth_m is not None and example.answer_m is not None:
            drawn["distance_surface"] = plots.surface(self.places_m, example.field, example.truth_m, example.answer_m)
        return drawn

    def pictures(self, places: Ints) -> Bytes:
        """The images of places (N,), taken anew by the run's sensor: a map keeps none."""
        plan = Plan(self.places.keys, self.places.T_world_camera).at(places)
        return np.concatenate([frames.images for frames in self.parts.sensor.frames(plan)])

    def worst(self, plan: Plan, scored: Scored, seed: int) -> Any:
        """A figure of the worst answers: queries beside what they were taken for."""
        worst = np.argsort(-scored.error_m, kind="stable")[:WORST]
        asked = self.parts.sensor.frames(plan.at(scored.plan_index[worst]))
        queries = [image for frames in asked for image in disturbed(frames, self.parts.disturbances, seed).images]
        answers = self.pictures(scored.place[worst])
        return plots.worst(queries, list(answers), scored.error_m[worst], scored.verdict[worst])


def estimate_of(scored: Scored, i: int) -> Estimate:
    """One answer, for the logs."""
    heading = float(scored.answer_heading_rad[i])
    return Estimate(
        scored.truth_m[i], scored.answer_m[i], str(scored.verdict[i]),
        float(heading_of(scored.truth[i])), heading if np.isfinite(heading) else None,
    )  # fmt: skip
