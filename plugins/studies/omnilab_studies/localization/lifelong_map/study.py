"""Maps that adapt to change over days, by several policies side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Answers,
    Metric,
    Parts,
    PlaceMap,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, did_you_mean
from omnilab.metrics import spacing
from omnilab_studies.common.describing import describe, describe_places, fitted
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.methods import check_comparisons
from omnilab_studies.common.pose_sources import changed, random_poses
from omnilab_studies.common.scores import Degeneracy, check_apart
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.lifelong_map import figures
from omnilab_studies.localization.lifelong_map.layout import layout_of
from omnilab_studies.localization.lifelong_map.policies import policy_of
from omnilab_studies.localization.lifelong_map.policy_run import PolicyRun
from omnilab_studies.localization.lifelong_map.results import key_of, metrics_of, rows_of, short

UNCHANGED = "unchanged"
DAY_NS = 100_000_000  # between two days, in the logs


@dataclass
class LifelongMap:
    """Lifelong mapping: a map of places, days in which light and things change, and policies that adapt the map.

    Made on the day before the first, from the sensor as it is. Each day has a condition, settings of the sensor and of the
    run's disturbances (`{dusk: {variant: moved, light: {gain: 0.6}}}`; `unchanged`: none), and its own random queries; every
    policy localises them in its own map by the nearest place, and adapts that map at the end of the day: `fixed`
    (never), `update` (the last appearance of each place), `several` (up to k of each, the least recently matched is
    forgotten). A policy sees the robot's estimates, never the truth, so that wrong ones get into its map.
    """

    days: list[str] = setting([])  # the condition of each day
    conditions: dict[str, dict[str, Any]] = setting(
        {}
    )  # name: {setting of the sensor: value, disturbance: {setting: value}}
    policies: dict[str, dict[str, Any]] = setting(
        {"fixed": {}, "update": {}, "several": {}}
    )  # name: {policy: fixed, update or several (by default the name), setting of it: value}
    step_m: float = setting(0.3, above=0)  # of the grid of places
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    query_count: int = setting(200, at_least=1, at_most=1_000_000)  # of each day
    heading_step_deg: float | None = setting(
        None, at_least=1e-6, at_most=180
    )  # random headings are multiples of it; null: any heading
    apart_steps: float = setting(1.5, above=0)  # places farther from the estimated one than so many steps are elsewhere

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance")
    metric_names: ClassVar[tuple[str, ...]] = (
        "POLICY_nearest_rate_mean", "POLICY_nearest_rate_last", "POLICY_wrong_update_share", "POLICY_wrong_signature_share",
        "POLICY_signatures", "places",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Make the map; each day, localise its queries in every policy's map, score, adapt."""
        self._check_days()
        policies = {name: policy_of(name, settings) for name, settings in self.policies.items()}
        start_logs(record, layout_of([key_of(name) for name in policies]), parts.sensor)
        grid = parts.sensor.plan(grid_poses(self.step_m, None, self.extent_m, self.height_m))
        parts = fitted(parts, grid, record)
        worlds = self._worlds(parts)
        places, omitted = describe_places(parts, grid, record)
        Degeneracy(places).log_map(record)
        runs = [PolicyRun(name, own, places, parts.distance, self.apart_steps) for name, own in policies.items()]
        check_apart(runs[0].places_m, spacing(runs[0].places_m))
        check_comparisons(self.query_count, len(places))
        record.log("places", PlaceMap(runs[0].places_m))

        for day, condition in enumerate(self.days):
            omitted += self._live(runs, worlds[condition], day, record, rng)
        rows = [row for run in runs for row in rows_of(run, self.days, rng)]
        _show_days(record, rows)
        return Report(
            [*(metric for run in runs for metric in metrics_of(run, rng)), Metric("places", len(places), "1")],
            {"days": columns_of(rows)},
            {"days": figures.days(rows)},
            summary=f"## Lifelong map\n\nRate of nearest answers\n\n{markdown(columns_of(short(rows)))}",
            omitted=omitted,
        )

    def _check_days(self) -> None:
        """ConfigError unless there are days with conditions that are known, and policies."""
        known = [UNCHANGED, *self.conditions]
        if not self.days:
            raise ConfigError(f"study.days is empty, so nothing is localised; give conditions, such as [{UNCHANGED}]")
        if not self.policies:
            raise ConfigError(
                "study.policies is empty; give {NAME: {SETTING: VALUE}}, such as {update: {sure_ratio: 0.8}}"
            )
        if UNCHANGED in self.conditions:
            raise ConfigError(f"study.conditions.{UNCHANGED} is the world as it is; give your condition another name")
        for name in self.days:
            if name not in known:
                raise ConfigError(
                    f"study.days names '{name}', which is no condition; there is {', '.join(known)}{did_you_mean(name, known)}"
                )

    def _worlds(self, parts: Parts) -> dict[str, Parts]:
        """The parts in each condition: the sensor and the disturbances changed."""
        return {UNCHANGED: parts} | {name: _in_condition(parts, name, to) for name, to in self.conditions.items()}

    def _live(
        self, runs: Sequence[PolicyRun], parts: Parts, day: int, record: Recorder, rng: np.random.Generator
    ) -> list[str]:
        """One day: every policy localises the same queries, then adapts. What was left out, in sentences."""
        seed, disturbance_seed = (int(n) for n in rng.integers(2**32, size=2))
        poses = random_poses(self.query_count, seed, self.heading_step_deg, self.extent_m, self.height_m)
        plan, tick = parts.sensor.plan(poses), Tick(day, DAY_NS * day)
        omitted, shown = list(plan.omitted), False
        record.log("log", Text(f"day {day + 1}: {self.days[day]}"), tick)
        for run in runs:
            run.begin_day()
        for frames in deliver_queries(parts, plan, record, disturbance_seed):
            omitted += frames.omitted
            if not len(frames):
                continue
            if not shown:
                show_picture(record, frames, 0, tick)
                shown = True
            signatures = describe(parts.descriptor, frames, record)
            for run in runs:
                with record.timed(f"localise: {run.name}", len(frames)):
                    run.localize(frames, signatures)
        for run in runs:
            scored = run.end_day(day).scored
            record.log(
                f"answers/{key_of(run.name)}", Answers(scored.truth_m, scored.answer_m, list(scored.verdict)), tick
            )
        return omitted


def _in_condition(parts: Parts, name: str, settings: Mapping[str, Any]) -> Parts:
    """The parts with other settings of the sensor, or, by their names, of disturbances."""
    where = f"study.conditions.{name}"
    of_sensor = {key: value for key, value in settings.items() if key not in parts.disturbances}
    for key, value in of_sensor.items():
        if isinstance(value, Mapping):
            raise ConfigError(
                f"{where}.{key} is no disturbance of the run; it has {', '.join(parts.disturbances) or 'none'}: give"
                f" disturbance=[{key}], too"
            )
    disturbances = {
        key: changed(own, f"{where}.{key}", settings[key], key) if key in settings else own
        for key, own in parts.disturbances.items()
    }
    return replace(parts, sensor=changed(parts.sensor, where, of_sensor), disturbances=disturbances)


def _show_days(record: Recorder, rows: Sequence[Mapping[str, Any]]) -> None:
    """The curves over the days."""
    for name in dict.fromkeys(row["policy"] for row in rows):
        own = [row for row in rows if row["policy"] == name]
        steps = np.arange(len(own))
        for path, column in (("nearest", "nearest_rate"), ("signatures",) * 2, ("wrong_signatures",) * 2):
            values = np.array([float(row[column]) for row in own])
            record.log(f"{path}/{key_of(name)}", Series(values, steps, DAY_NS * steps, "1"))
