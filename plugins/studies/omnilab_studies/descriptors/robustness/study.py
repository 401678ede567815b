"""Study F: methods on disturbed queries, level by level (thesis, 4.6.5)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Frames,
    GridPoses,
    Parts,
    PlaceMap,
    Plan,
    RandomPoses,
    RecordedPoses,
    Recorder,
    Report,
    Sensor,
    Series,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab_studies.common.disturbance_levels import Level, check_levels, levels_of
from omnilab_studies.common.frames import deliver, disturbed
from omnilab_studies.common.free_area import free_square, poses_with_headings, positions_within
from omnilab_studies.common.localization_run import estimate_of
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.method_runs import MethodCost, MethodRuns
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.scores import known_poses
from omnilab_studies.common.tables import columns_of
from omnilab_studies.descriptors.robustness import figures
from omnilab_studies.descriptors.robustness.layout import LAYOUT
from omnilab_studies.descriptors.robustness.results import Comparison, markdown_of, metrics_of, summary_of

LEVEL_NS = 100_000_000  # between two levels, in the logs


@dataclass
class Robustness:
    """Study F: localisation by several descriptors as queries are disturbed (Berenguer, thesis, 4.6.5, fig. 4.23).

    `side` x `side` places, or those of all that the sensor covers, or of a recording (`every`); the same queries, with the same noise, for every method: clear, then with each of the run's
    disturbances alone, at each of its `levels`, from mild to strong. `area` is the mean rate of nearest answers
    over a disturbance's levels, or over all; the breakdown point is its first level at which that rate is below half of
    the clear one. The sharpness C (eq. 4.6, figure 4.24) is that of the clear queries. The logs show image and estimates of
    the first query, one step a level.
    """

    side: int | None = setting(8, at_least=2, at_most=1000)  # places along x and along y; null: all that is free
    step_m: float = setting(0.2, above=0)  # between places
    every: int | None = setting(
        None, at_least=1
    )  # of a recording: each n-th of its rows and columns are the places, and queries are drawn from its other images
    center_m: list[float] = setting([0.0, 0.0], count=2)  # the map is the free square nearest to it
    query_count: int = setting(200, at_least=1, at_most=1_000_000)  # queries at each level, evenly over the map's area
    heading_steps: int | None = setting(
        None, at_least=1, at_most=1_000_000
    )  # headings are multiples of 360/heading_steps degrees; null: any heading
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    levels: dict[str, dict[str, list[Any]]] = setting({})  # of a disturbance: {setting: [values]}
    corrections: list[str] = setting([])  # disturbances that follow each level, such as upright_adjustment

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizer", "disturbances")
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_area", "METHOD_clear_rate", "METHOD_area_DISTURBANCE", "METHOD_heading_error_median",
        "METHOD_sharpness_mean", "METHOD_bytes_per_place",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_levels(self.levels)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the map, localise the queries at every level by every method, compare."""
        start_logs(record, LAYOUT, parts.sensor)
        levels = levels_of(self.levels, parts.disturbances, record, self.corrections)
        grid = self._grid(parts.sensor)
        places_m = known_poses(grid.T_world_camera, "places")[:, :3, 3]
        record.log("places", PlaceMap(places_m))
        plan = self._query_plan(parts.sensor, grid, rng)
        seed = int(rng.integers(2**32))  # of the disturbances

        runs = MethodRuns(parts, grid, record)
        comparison = _localize(runs, deliver(parts, plan, record, "queries"), len(plan), levels, record, seed)
        costs = {method.name: runs.cost(method) for method in runs.methods}
        runs.log_degeneracy()

        _show_rates(record, comparison)
        summary = summary_of(comparison, costs)
        tables = {"robustness": columns_of(summary), "levels": comparison.table()}
        drawn = _figures(comparison, costs, places_m, len(plan))
        text = markdown_of(summary, levels, comparison.rates)
        return Report(metrics_of(comparison, costs), tables, drawn, summary=text)

    def _grid(self, sensor: Sensor) -> Plan:
        if self.every is not None:
            return sensor.plan(GridPoses(every=self.every))
        if self.side is None:
            return sensor.plan(GridPoses(self.step_m, height_m=self.height_m))
        return free_square(sensor, self.side, self.step_m, self.center_m, self.height_m)

    def _query_plan(self, sensor: Sensor, grid: Plan, rng: np.random.Generator) -> Plan:
        if self.every is not None:
            rest = sensor.plan(RecordedPoses(without=GridPoses(every=self.every)))
            return rest.at(np.sort(rng.permutation(len(rest))[: self.query_count]))
        if self.side is None:
            step = None if self.heading_steps is None else 2 * np.pi / self.heading_steps
            return sensor.plan(RandomPoses(self.query_count, int(rng.integers(2**32)), step, None, self.height_m))
        at = positions_within(grid, self.query_count, rng)
        return sensor.plan(poses_with_headings(at, rng.random(self.query_count), self.heading_steps))


def _figures(comparison: Comparison, costs: Mapping[str, MethodCost], places_m: Floats, count: int) -> dict[str, Any]:
    clear = comparison.at(0)
    areas = {name: comparison.area(name) for name in comparison.names}
    first = next(iter(clear.values()))
    sharpness = {name: scored.sharpness for name, scored in clear.items() if np.isfinite(scored.sharpness).all()}
    drawn = {
        "pictures": figures.pictures(comparison.pictures, comparison.levels),
        "rates": figures.rates(comparison.rates, comparison.levels, count),
        "pareto": figures.pareto(costs, areas, "mean rate of nearest answers over all levels"),
    }
    if sharpness:
        drawn["sharpness"] = figures.sharpness(sharpness)
    if comparison.fields:
        drawn["surfaces"] = figures.surfaces(places_m, comparison.fields, first.truth_m[0])
    return drawn


def _localize(
    runs: MethodRuns, batches: Iterable[Frames], count: int, levels: Sequence[Level], record: Recorder, seed: int
) -> Comparison:
    """Localise `count` queries, imaged once, at every level by every method; the first one goes into the logs."""
    comparison = Comparison([method.name for method in runs.methods], levels)
    at_levels = _at_levels(batches, levels, record, seed)
    for step, frames in record.track(at_levels, "levels", count * len(levels), lambda item: len(item[1])):
        tick = Tick(step, LEVEL_NS * step)
        if first := 0 in frames.plan_index:
            comparison.pictures.append(frames.images[0])
            show_picture(record, frames, 0, tick)
            record.log("log", Text(levels[step].title), tick)
        for found in runs.localize(frames):
            comparison.add(step, found)
            if first:
                record.log(f"estimate/{key_of(found.method.name)}", estimate_of(found.scored, 0), tick)
    return comparison


def _at_levels(
    batches: Iterable[Frames], levels: Sequence[Level], record: Recorder, seed: int
) -> Iterator[tuple[int, Frames]]:
    """Each batch of queries, disturbed as at each level; an image has the same noise at all levels."""
    for frames in batches:
        for step, level in enumerate(levels):
            with record.timed("disturb", len(frames)):
                noisy = disturbed(frames, level.applied, seed)
            yield step, noisy


def _show_rates(record: Recorder, comparison: Comparison) -> None:
    """The rate of nearest estimates over the levels, for every method."""
    steps = np.arange(len(comparison.levels))
    for name, rates in comparison.rates.items():
        record.log(f"nearest/{key_of(name)}", Series(rates, steps, LEVEL_NS * steps, "1"))
