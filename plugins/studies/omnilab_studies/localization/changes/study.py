"""Study C: localisation after changes of light and things (thesis, figure 4.18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from omnilab.api import (
    Answers,
    Bytes,
    Metric,
    Parts,
    PlaceMap,
    Plan,
    PoseRequest,
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
from omnilab.errors import ConfigError
from omnilab.metrics import VERDICTS, bootstrap
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.localization_run import estimate_of
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.method_runs import MethodRuns
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.pose_sources import Source, changed, random_poses
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.changes import figures
from omnilab_studies.localization.changes.layout import LAYOUT

UNCHANGED = "unchanged"
CONDITION_NS = 100_000_000  # between two conditions, in the logs


@dataclass
class Changes:
    """Study C: light and things change after the map was made (Berenguer, thesis, 4.6.3, fig. 4.18).

    Places from the sensor as it is; queries from it with other settings, a condition each: a variant of the virtual world
    (`{evening: {variant: evening}}`), or another folder (`{chairs: {path: DIR/chairs}}`). Random queries are at the same
    poses in every condition, but for those where something now stands, and in the unchanged world too; recorded ones are
    drawn from each folder. An estimate is `nearest`, `second` or `wrong` as in the grid study; each rate with its 95 %
    interval.
    """

    conditions: dict[str, dict[str, Any]] = setting({})  # name: {setting of the sensor: value}
    step_m: float | None = setting(
        0.2, above=0
    )  # of the grid of places; null: take `every` n-th row and column of a recording
    every: int | None = setting(None, at_least=1)  # 1: all that was recorded
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    queries: Source = Source.random  # or recorded
    query_count: int = setting(200, at_least=1, at_most=1_000_000)  # of each condition
    heading_step_deg: float | None = setting(
        None, at_least=1e-6, at_most=180
    )  # random headings are multiples of it; null: any heading

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizer")
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_nearest_rate_worst", "METHOD_nearest_or_second_rate_worst", "METHOD_CONDITION_nearest_rate",
        "METHOD_CONDITION_nearest_or_second_rate", "places",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_step_or_every(self.step_m, self.every)
        if self.queries not in (Source.random, Source.recorded):
            raise ConfigError(f"study.queries={self.queries.value} is not possible here; give random or recorded")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the map; in each condition, localise the queries; score."""
        if not self.conditions:
            raise ConfigError("study.conditions is empty, so nothing changes; give {NAME: {SETTING: VALUE}}, such as"
                              " {evening: {variant: evening}}")  # fmt: skip
        start_logs(record, LAYOUT, parts.sensor)
        seed, disturbance_seed = (int(n) for n in rng.integers(2**32, size=2))
        sensors = self._sensors(parts.sensor)
        plans = {name: self._plan(sensor, seed, i) for i, (name, sensor) in enumerate(sensors.items())}
        grid = parts.sensor.plan(grid_poses(self.step_m, self.every, self.extent_m, self.height_m))
        runs = MethodRuns(parts, grid, record)
        record.log("places", PlaceMap(known_poses(grid.T_world_camera, "places")[:, :3, 3]))

        results: dict[str, ConditionResult] = {}
        for step, (name, sensor) in enumerate(sensors.items()):
            tick = Tick(step, CONDITION_NS * step)
            own = replace(parts, sensor=sensor)
            results[name] = _localize(runs, own, plans[name], record, disturbance_seed, tick)
            record.log("log", Text(name), tick)

        runs.log_degeneracy()
        rows = [_row(m, name, s, rng) for name, result in results.items() for m, s in result.scored.items()]
        _show_rates(record, rows, list(sensors))
        images = {name: result.image for name, result in results.items()}
        return Report(
            _metrics(rows, len(grid)),
            {"changes": columns_of(rows)},
            {"changes": figures.rates(rows), "pictures": figures.pictures(images)},
            summary=f"## Changes\n\n{markdown(columns_of(_short(rows)))}",
            omitted=[*grid.omitted, *(sentence for result in results.values() for sentence in result.omitted)],
        )

    def _sensors(self, sensor: Sensor) -> dict[str, Sensor]:
        """The sensor of each condition; the first is the unchanged one, where it can image random poses."""
        unchanged = {UNCHANGED: sensor} if self.queries is Source.random else {}
        return unchanged | {
            name: changed(sensor, f"study.conditions.{name}", to) for name, to in self.conditions.items()
        }

    def _plan(self, sensor: Sensor, seed: int, number: int) -> Plan:
        """The queries of a condition; of more recorded images, `query_count` drawn by the condition's number."""
        plan = sensor.plan(self._query_poses(seed))
        if self.queries is Source.recorded and len(plan) > self.query_count:
            chosen = np.random.default_rng([seed, number]).choice(len(plan), self.query_count, replace=False)
            plan = plan.at(np.sort(chosen))
        return plan

    def _query_poses(self, seed: int) -> PoseRequest:
        if self.queries is Source.recorded:
            return RecordedPoses()
        return random_poses(self.query_count, seed, self.heading_step_deg, self.extent_m, self.height_m)


class ConditionResult(NamedTuple):
    """Results of the methods in one condition."""

    scored: Mapping[str, ScoredEstimates]  # of each method
    image: Bytes  # the first query
    omitted: Sequence[str]


def _localize(runs: MethodRuns, parts: Parts, plan: Plan, record: Recorder, seed: int, tick: Tick) -> ConditionResult:
    """Localise the queries of one condition by every method."""
    batches: dict[str, list[ScoredEstimates]] = {method.name: [] for method in runs.methods}
    images: list[Bytes] = []
    omitted = list(plan.omitted)
    for frames in deliver_queries(parts, plan, record, seed):
        omitted += frames.omitted
        if not images and len(frames):
            images.append(frames.images[0])
            show_picture(record, frames, 0, tick)
        for found in runs.localize(frames):
            batches[found.method.name].append(found.scored)
    scored = {name: joined_estimates(own) for name, own in batches.items()}
    _show_estimates(record, scored, tick)
    return ConditionResult(scored, images[0], omitted)


def _row(method: str, condition: str, scored: ScoredEstimates, rng: np.random.Generator) -> dict[str, Any]:
    """One method in one condition."""
    nearest = scored.verdict == "nearest"
    known = nearest | (scored.verdict == "second")
    low, high = bootstrap(lambda chosen: float(nearest[chosen].mean()), len(nearest), rng)
    low2, high2 = bootstrap(lambda chosen: float(known[chosen].mean()), len(nearest), rng)
    return {
        "method": method,
        "condition": condition,
        "queries": len(nearest),
        **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
        "nearest_low": low,
        "nearest_high": high,
        "nearest_or_second_rate": float(known.mean()),
        "nearest_or_second_low": low2,
        "nearest_or_second_high": high2,
        "position_error_median_m": float(np.median(scored.error_m)),
        "heading_error_median_deg": of_known(np.median, scored.heading_error_deg),
    }


def _short(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The columns of the summary."""
    kept = ("method", "condition", "queries", "nearest_rate", "nearest_or_second_rate", "position_error_median_m")
    return [{name: row[name] for name in kept} for row in rows]


def _show_estimates(record: Recorder, scored: Mapping[str, ScoredEstimates], tick: Tick) -> None:
    """The first method's estimates for all queries of a condition, and every method's for the first query."""
    first = next(iter(scored.values()))
    record.log("answers", Answers(first.truth_m, first.answer_m, list(first.verdict)), tick)
    for name, own in scored.items():
        record.log(f"estimate/{key_of(name)}", estimate_of(own, 0), tick)


def _show_rates(record: Recorder, rows: Sequence[Mapping[str, Any]], conditions: Sequence[str]) -> None:
    steps = np.arange(len(conditions))
    for name in dict.fromkeys(row["method"] for row in rows):
        rates = np.array([row["nearest_rate"] for row in rows if row["method"] == name])
        record.log(f"nearest/{key_of(name)}", Series(rates, steps, CONDITION_NS * steps, "1"))


def _metrics(rows: Sequence[Mapping[str, Any]], places: int) -> list[Metric]:
    """The rates of each method in its worst changed condition first, then those of all conditions."""
    found: list[Metric] = []
    for name in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == name and row["condition"] != UNCHANGED]
        for rate in ("nearest", "nearest_or_second"):
            worst = min(own, key=lambda row: row[f"{rate}_rate"])
            interval = (worst[f"{rate}_low"], worst[f"{rate}_high"])
            found.append(Metric(f"{key_of(name)}_{rate}_rate_worst", worst[f"{rate}_rate"], "1", interval))
    for row in rows:
        key = f"{key_of(row['method'])}_{str(row['condition']).replace(' ', '_')}"
        found.append(Metric(f"{key}_nearest_rate", row["nearest_rate"], "1", (row["nearest_low"], row["nearest_high"])))
        interval = (row["nearest_or_second_low"], row["nearest_or_second_high"])
        found.append(Metric(f"{key}_nearest_or_second_rate", row["nearest_or_second_rate"], "1", interval))
    return [*found, Metric("places", places, "1")]
