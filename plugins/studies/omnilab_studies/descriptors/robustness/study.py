"""Study F: methods on disturbed queries, level by level."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Estimate,
    Floats,
    Frames,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
)
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of
from omnilab_studies.common.disturbance_levels import Level, check_levels, levels_of
from omnilab_studies.common.frames import deliver, disturbed
from omnilab_studies.common.free_area import check_square, free_square, poses_with_headings, positions_within
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.method_runs import MethodCost, MethodEstimates, MethodRuns
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.tables import columns_of
from omnilab_studies.descriptors.robustness import figures
from omnilab_studies.descriptors.robustness.layout import LAYOUT
from omnilab_studies.descriptors.robustness.results import Comparison, markdown_of, metrics_of, summary_of

LEVEL_NS = 100_000_000  # between two levels, in the logs


@dataclass
class Robustness:
    """Study F: how the answers of several descriptors fare as queries get worse (Berenguer, thesis, 4.6.5, fig. 4.23).

    `side` x `side` places; the same queries, spoilt in the same way, for every method: clear, then by each of the
    run's disturbances alone, at each of its `levels`, from mild to strong. `area` is the mean rate of nearest answers
    over a disturbance's levels, or over all; the breakdown point is its first level at which that rate is below half of
    the clear one. The sharpness C (eq. 4.6, figure 4.24) is that of the clear queries. The pictures and the answers that
    go into the logs are those of the first query, one step a level.
    """

    side: int = 8  # places along x and along y
    step_m: float = 0.2  # between places
    center_m: list[float] = field(default_factory=lambda: [0.0, 0.0])  # the map is the free square nearest to it
    query_count: int = 200  # queries at each level, evenly over the map's area
    heading_steps: int | None = None  # headings are whole steps of so many in a turn; null: any heading
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    levels: dict[str, dict[str, list[Any]]] = field(default_factory=dict)  # of a disturbance: {setting: [values]}

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizer", "disturbances")
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_square(self.side, self.step_m, self.center_m, self.query_count)
        if self.heading_steps is not None and self.heading_steps < 1:
            raise ConfigError(
                f"study.heading_steps={self.heading_steps} are no headings; give 1 or more, or null for any"
            )
        check_levels(self.levels)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map, spoil, localise, score."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        levels = levels_of(self.levels, parts.disturbances, record)

        # the map: described by every method
        grid = free_square(parts.sensor, self.side, self.step_m, self.center_m, self.height_m)
        places_m = _positions(grid)
        record.log("places", PlaceMap(places_m))
        at = positions_within(grid, self.query_count, rng)
        plan = parts.sensor.plan(poses_with_headings(at, rng.random(self.query_count), self.heading_steps))
        seed = int(rng.integers(2**32))
        runs = MethodRuns(parts, grid, record)

        # the queries: each batch is imaged once, then spoilt and answered at every level
        comparison = Comparison([c.name for c in runs.methods], levels)
        at_levels = _at_levels(deliver(parts, plan, record, "queries"), levels, record, seed)
        for step, frames in record.track(at_levels, "levels", len(plan) * len(levels), lambda item: len(item[1])):
            if first := 0 in frames.plan_index:
                comparison.pictures.append(frames.images[0])
                _show_query(record, step, levels[step], frames)
            for answered in runs.localize(frames):
                comparison.take(step, answered)
                if first:
                    _show_answer(record, step, answered)
        costs = {c.name: runs.cost(c) for c in runs.methods}

        # what it amounts to
        steps = np.arange(len(levels))
        for name, rates in comparison.rates.items():
            record.log(f"nearest/{key_of(name)}", Series(rates, steps, LEVEL_NS * steps, "1"))
        summary = summary_of(comparison, costs)
        record.log("summary", Text(markdown_of(summary, levels, comparison.rates), markdown=True))
        tables = {"robustness": columns_of(summary), "levels": comparison.table()}
        return Report(metrics_of(comparison, costs), tables, self._figures(comparison, costs, places_m))

    def _figures(self, comparison: Comparison, costs: Mapping[str, MethodCost], places_m: Floats) -> dict[str, Any]:
        clear = comparison.at(0)
        areas = {name: comparison.area(name) for name in comparison.names}
        first = next(iter(clear.values()))
        sharpness = {name: scored.sharpness for name, scored in clear.items() if np.isfinite(scored.sharpness).all()}
        drawn = {
            "pictures": figures.pictures(comparison.pictures, comparison.levels),
            "rates": figures.rates(comparison.rates, comparison.levels, self.query_count),
            "pareto": figures.pareto(costs, areas, "mean rate of nearest answers over all levels"),
        }
        if sharpness:
            drawn["sharpness"] = figures.sharpness(sharpness)
        if comparison.fields:
            drawn["surfaces"] = figures.surfaces(places_m, comparison.fields, first.truth_m[0])
        return drawn


def _at_levels(
    batches: Iterable[Frames], levels: Sequence[Level], record: Recorder, seed: int
) -> Iterator[tuple[int, Frames]]:
    """Each batch of queries, spoilt as at each level; the same noise for the same image at all strengths."""
    for frames in batches:
        for step, level in enumerate(levels):
            with record.timed("disturb", len(frames)):
                spoilt = disturbed(frames, level.applied, seed)
            yield step, spoilt


def _show_query(record: Recorder, step: int, level: Level, frames: Frames) -> None:
    """The first query's picture at a level."""
    tick = Tick(step, LEVEL_NS * step)
    show_picture(record, frames, 0, tick)
    record.log("log", Text(level.title), tick)


def _show_answer(record: Recorder, step: int, answered: MethodEstimates) -> None:
    """Where a method takes the first query to be."""
    scored = answered.scored
    heading = float(scored.answer_heading_rad[0])
    truth_heading = float(heading_of(scored.truth[0]))
    estimate = Estimate(
        scored.truth_m[0], scored.answer_m[0], str(scored.verdict[0]),
        truth_heading, heading if np.isfinite(heading) else None,
    )  # fmt: skip
    record.log(f"estimate/{key_of(answered.method.name)}", estimate, Tick(step, LEVEL_NS * step))


def _positions(plan: Plan) -> Floats:
    assert plan.T_world_camera is not None
    return plan.T_world_camera[:, :3, 3]
