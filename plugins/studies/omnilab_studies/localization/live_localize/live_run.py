"""A saved map, and the frames that are localised in it one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import (
    Answers,
    DistanceField,
    Estimates,
    Frames,
    Image,
    Metric,
    Plan,
    Pose,
    Report,
    Series,
    Signatures,
    Text,
    Tick,
)
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab_studies.common.describing import describe
from omnilab_studies.common.live.figures import latency
from omnilab_studies.common.live.pacing import ArrivedFrame, PacedFrames
from omnilab_studies.common.localization_metrics import localization_metrics, map_metrics
from omnilab_studies.common.localization_run import LocalizationRun, answer_row, estimate_of
from omnilab_studies.common.logs import show_frame
from omnilab_studies.common.plots import pixels_of
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, query_table
from omnilab_studies.common.tables import columns_of, markdown_table
from omnilab_studies.localization.figures import localization_figures

TITLE = "Live localisation"  # of the summary


@dataclass
class LiveRun:
    """Localises frames as they come, and reports on all of them at the end."""

    run: LocalizationRun
    plan: Plan
    scored: list[ScoredEstimates] = field(default_factory=list)  # where the sensor knows poses
    answers: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._shown = set(evenly(len(self.plan), self.run.show).tolist()) if self.run.show else set[int]()

    def localize(self, arrived: ArrivedFrame, frames: PacedFrames) -> None:
        """Answer one frame, then log it."""
        frame, record = arrived.frame, self.run.record
        tick = Tick(int(frame.plan_index[0]), int(frame.stamps_ns[0]))
        with frames.answering(arrived, record):
            signatures = describe(self.run.parts.descriptor, frame, record)
            with record.timed("localise"):
                estimates = self.run.locate(signatures)
        self.answers.append(answer_row(tick.step, self.plan.keys[tick.step], estimates, 0))
        self._log(frame, signatures, estimates, tick)

    def _log(self, frame: Frames, signatures: Signatures, estimates: Estimates, tick: Tick) -> None:
        """Answer and distance of every frame, and its error where the truth is known; images of some."""
        record, step, stamp = self.run.record, np.array([tick.step]), np.array([tick.stamp_ns])
        heading = np.zeros(1) if estimates.heading_rad is None else np.nan_to_num(estimates.heading_rad)
        record.log("answer", Pose(planar_poses(estimates.position_m, heading)[0]), tick)
        record.log("distance", Series(estimates.distance, step, stamp, "1"))
        if frame.T_world_camera is not None:
            scored = self.run.score(frame, signatures, estimates)
            self.scored.append(scored)
            record.log("error/position_m", Series(scored.error_m, step, stamp, "m"))
            record.log("estimate", estimate_of(scored, 0), tick)
        if tick.step in self._shown:
            show_frame(record, frame, 0, signatures.place[0], tick)
            if estimates.field is not None:
                record.log("distances", DistanceField(self.run.places_m, estimates.field[0]), tick)

    def report(self, frames: PacedFrames, rng: np.random.Generator) -> Report:
        """Metrics of the frames that were answered, and how long that took. DataError where none was."""
        if not self.answers:
            raise DataError("the sensor delivered no frame that could be localised; give another recording")
        omitted = [*self.plan.omitted, *frames.omitted]
        found = self._scores(len(omitted), rng) if self.scored else self._unscored()
        metrics = [*found.metrics, Metric("dropped", len(frames.dropped), "1")]
        drawn = latency(frames.latencies, frames.dropped)
        self.run.record.log("log", Text(frames.in_words(), "NOTE"))
        return Report(
            metrics,
            tables={**found.tables, "latency": frames.latencies.table()},
            figures={**found.figures, "latency": drawn},
            summary=f"{markdown_table(metrics, TITLE)}\n\n{frames.in_words()}",
            omitted=omitted,
        )

    def _scores(self, left_out: int, rng: np.random.Generator) -> Report:
        run, scored = self.run, joined_estimates(self.scored)
        run.log_degeneracy()
        run.record.log("answers", Answers(scored.truth_m, scored.answer_m, list(scored.verdict)))
        metrics = localization_metrics(scored, len(run.places), run.step_m, rng)
        metrics += map_metrics(run.places, scored, left_out)
        drawn = localization_figures(run, scored)
        run.record.log("recall", Image(pixels_of(drawn["recall"]), "png"))
        return Report(metrics, {"queries": query_table(scored, self.plan.keys)}, drawn)

    def _unscored(self) -> Report:
        """Of frames whose poses nobody knows: no errors are known."""
        distance = float(np.median([row["distance"] for row in self.answers]))
        metrics = [
            Metric("queries", len(self.answers), "1"),
            Metric("distance_median", distance, "1"),
            Metric("places", len(self.run.places), "1"),
        ]
        return Report(metrics, {"answers": columns_of(self.answers)})
