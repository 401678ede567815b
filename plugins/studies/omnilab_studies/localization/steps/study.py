"""Study A over several steps of the map (thesis, figures 4.13 and 4.14)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from omnilab.api import (
    Answers,
    Metric,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Sensor,
    Series,
    Tick,
    check_settings,
    setting,
)
from omnilab.geometry import heading_of
from omnilab.metrics import VERDICTS, bootstrap
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.free_area import poses_with_headings
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.method_runs import MethodCost, MethodRuns
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.steps import figures
from omnilab_studies.localization.steps.layout import LAYOUT

ANY, ON_GRID = "any", "on_grid"  # kinds of headings
STEP_NS = 100_000_000  # between two steps, in the logs


@dataclass
class Steps:
    """Study A: how far apart places may be (Berenguer, thesis, 4.6.3.1, figures 4.13 and 4.14).

    Queries at the same positions are localised in maps of several steps, once with headings on the angle grid, where a
    rotation shifts a signature by whole samples, and once with any heading. Rates of nearest, second and wrong estimates
    and the mean heading error of every method. `experiment=grid` shows one step in depth.
    """

    steps_m: list[float] = setting([0.1, 0.2, 0.3, 0.4], above=0, fewest=1)  # of the maps
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the maps; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    query_count: int = setting(3500, at_least=1, at_most=1_000_000)  # of each kind of headings
    heading_steps: int = setting(
        180, at_least=1, at_most=1_000_000
    )  # angles of the descriptor's grid, in a full rotation

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizer")
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_STEP_HEADINGS_nearest_rate", "METHOD_STEP_HEADINGS_wrong_rate",
        "METHOD_STEP_HEADINGS_heading_error_mean",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map after map: describe the places, localise the queries with both kinds of headings, score."""
        start_logs(record, LAYOUT, parts.sensor)
        plans, omitted = self._query_plans(parts.sensor, int(rng.integers(2**32)))
        results: dict[float, MapResult] = {}
        for number, step_m in enumerate(self.steps_m):
            results[step_m] = self._localize(parts, step_m, plans, record, Tick(number, STEP_NS * number))
            omitted += results[step_m].omitted

        rows = [_row(step_m, key, result, rng) for step_m, result in results.items() for key in result.scored]
        _show_rates(record, rows)
        tables = {"steps": columns_of(rows), "times": columns_of(_times(results))}
        drawn = {"success": figures.success(rows), "heading_error": figures.heading_error(rows)}
        summary = f"## Steps\n\n{markdown(columns_of(_short(rows)))}"
        return Report(_metrics(rows), tables, drawn, summary=summary, omitted=omitted)

    def _query_plans(self, sensor: Sensor, seed: int) -> tuple[dict[str, Plan], list[str]]:
        """The same random positions with each kind of headings, and what was left out."""
        free = sensor.plan(random_poses(self.query_count, seed, None, self.extent_m, self.height_m))
        truth = known_poses(free.T_world_camera, "queries")
        share = np.mod(heading_of(truth) / (2 * np.pi), 1)
        grids = {ANY: None, ON_GRID: self.heading_steps}
        plans = {k: sensor.plan(poses_with_headings(truth[:, :3, 3], share, steps)) for k, steps in grids.items()}
        return plans, list(free.omitted)

    def _localize(
        self, parts: Parts, step_m: float, plans: Mapping[str, Plan], record: Recorder, tick: Tick
    ) -> MapResult:
        """Describe the map of one step, and localise all queries in it by every method."""
        grid = parts.sensor.plan(grid_poses(step_m, None, self.extent_m, self.height_m))
        runs = MethodRuns(parts, grid, record)
        record.log("places", PlaceMap(known_poses(grid.T_world_camera, "places")[:, :3, 3]), tick)
        scored: dict[tuple[str, str], ScoredEstimates] = {}
        for kind, plan in plans.items():
            batches: dict[str, list[ScoredEstimates]] = {method.name: [] for method in runs.methods}
            for frames in deliver(parts, plan, record, f"{step_m:g} m, {kind} headings"):
                for found in runs.localize(frames):
                    batches[found.method.name].append(found.scored)
            scored |= {(name, kind): joined_estimates(own) for name, own in batches.items()}
        runs.log_degeneracy()
        show_picture(record, frames, 0, tick)
        shown = scored[runs.methods[0].name, ANY]
        record.log("answers", Answers(shown.truth_m, shown.answer_m, list(shown.verdict)), tick)
        costs = {method.name: runs.cost(method) for method in runs.methods}
        return MapResult(len(grid), scored, costs, grid.omitted)


class MapResult(NamedTuple):
    """Results of the methods in the map of one step."""

    places: int
    scored: Mapping[tuple[str, str], ScoredEstimates]  # of a method, for a kind of headings
    costs: Mapping[str, MethodCost]  # of each method
    omitted: Sequence[str]


def _row(step_m: float, key: tuple[str, str], result: MapResult, rng: np.random.Generator) -> dict[str, Any]:
    (method, headings), scored = key, result.scored[key]
    nearest = scored.verdict == "nearest"
    low, high = bootstrap(lambda chosen: float(nearest[chosen].mean()), len(nearest), rng)
    return {
        "step_m": step_m,
        "method": method,
        "headings": headings,
        "places": result.places,
        "queries": len(nearest),
        **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
        "nearest_low": low,
        "nearest_high": high,
        "heading_error_mean_deg": of_known(np.mean, scored.heading_error_deg),
        "heading_error_median_deg": of_known(np.median, scored.heading_error_deg),
        "position_error_median_m": float(np.median(scored.error_m)),
    }


def _times(results: Mapping[float, MapResult]) -> list[dict[str, Any]]:
    """One row a map and method."""
    return [
        {"step_m": step_m, "method": name, "places": result.places, **cost._asdict()}
        for step_m, result in results.items()
        for name, cost in result.costs.items()
    ]


def _short(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The columns of the summary."""
    kept = ("step_m", "method", "headings", "nearest_rate", "wrong_rate", "heading_error_median_deg")
    return [{name: row[name] for name in kept} for row in rows]


def _show_rates(record: Recorder, rows: Sequence[Mapping[str, Any]]) -> None:
    """The rate of nearest estimates over the steps, for every method and kind of headings."""
    for name, headings in dict.fromkeys((row["method"], row["headings"]) for row in rows):
        rates = np.array([row["nearest_rate"] for row in rows if (row["method"], row["headings"]) == (name, headings)])
        steps = np.arange(len(rates))
        record.log(f"nearest/{key_of(name)}_{headings}", Series(rates, steps, STEP_NS * steps, "1"))


def _metrics(rows: Sequence[Mapping[str, Any]]) -> list[Metric]:
    """Rates of nearest estimates and heading errors, by method, step and kind of headings."""
    found = []
    for row in rows:
        key = f"{key_of(row['method'])}_{row['step_m']:g}m_{row['headings']}"
        found.append(Metric(f"{key}_nearest_rate", row["nearest_rate"], "1", (row["nearest_low"], row["nearest_high"])))
        found.append(Metric(f"{key}_wrong_rate", row["wrong_rate"], "1"))
        if np.isfinite(row["heading_error_mean_deg"]):
            found.append(Metric(f"{key}_heading_error_mean", row["heading_error_mean_deg"], "deg"))
    return found
