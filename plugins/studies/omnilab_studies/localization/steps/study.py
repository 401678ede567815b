"""Study A over several steps of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Answers, Metric, Parts, PlaceMap, RandomPoses, Recorder, Report, Series, Text, Tick
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of
from omnilab.metrics import VERDICTS, bootstrap
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.free_area import poses_with_headings
from omnilab_studies.common.grids import check_extent, check_step, grid_poses
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.method_runs import MethodCost, MethodRuns
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.steps import figures
from omnilab_studies.localization.steps.layout import LAYOUT

ANY, ON_GRID = "any", "on_grid"  # headings
STEP_NS = 100_000_000  # between two steps, in the logs

Key = tuple[float, str, str]  # step of the map, method, headings


@dataclass
class Steps:
    """Study A: how far apart places may be (Berenguer, thesis, 4.6.3.1, figures 4.13 and 4.14).

    The same positions asked in maps of several steps, once with headings on the angle grid, where a turn shifts a
    signature by whole samples, and once with any heading. Rates of nearest, second and wrong answers and the mean
    heading error of every method. `experiment=grid` shows one step in depth.
    """

    steps_m: list[float] = field(default_factory=lambda: [0.1, 0.2, 0.3, 0.4])  # of the maps
    extent_m: list[float] | None = None  # x and y size of the maps; null: all that the sensor covers
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    query_count: int = 3500  # of each kind of headings
    heading_steps: int = 180  # angles of the descriptor's grid, in a turn

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizer")

    def __post_init__(self) -> None:
        if not self.steps_m:
            raise ConfigError("study.steps_m=[] makes no map; give steps in metres, such as [0.2, 0.4]")
        for step_m in self.steps_m:
            check_step(step_m)
        check_extent(self.extent_m)
        if min(self.query_count, self.heading_steps) < 1:
            raise ConfigError(
                f"study.query_count={self.query_count}, study.heading_steps={self.heading_steps} ask nothing; give 1 or more"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map after map: describe, ask with both kinds of headings, score."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        extent = None if self.extent_m is None else (self.extent_m[0], self.extent_m[1])
        seed = int(rng.integers(2**32))
        free = parts.sensor.plan(RandomPoses(self.query_count, seed, None, extent, self.height_m))
        truth = known_poses(free.T_world_camera, "queries")
        turns = {ANY: None, ON_GRID: self.heading_steps}
        share = np.mod(heading_of(truth) / (2 * np.pi), 1)
        plans = {
            kind: parts.sensor.plan(poses_with_headings(truth[:, :3, 3], share, steps)) for kind, steps in turns.items()
        }

        answers: dict[Key, ScoredEstimates] = {}
        costs: dict[tuple[float, str], MethodCost] = {}
        places: dict[float, int] = {}
        omitted = list(free.omitted)
        for number, step_m in enumerate(self.steps_m):
            grid = parts.sensor.plan(grid_poses(step_m, None, self.extent_m, self.height_m))
            runs = MethodRuns(parts, grid, record)
            places[step_m] = len(grid)
            omitted += grid.omitted
            tick = Tick(number, STEP_NS * number)
            record.log("places", PlaceMap(known_poses(grid.T_world_camera, "places")[:, :3, 3]), tick)
            for kind, plan in plans.items():
                batches: dict[str, list[ScoredEstimates]] = {c.name: [] for c in runs.methods}
                for frames in deliver(parts, plan, record, f"{step_m:g} m, {kind} headings"):
                    for answered in runs.localize(frames):
                        batches[answered.method.name].append(answered.scored)
                answers |= {(step_m, name, kind): joined_estimates(scored) for name, scored in batches.items()}
            costs |= {(step_m, c.name): runs.cost(c) for c in runs.methods}
            show_picture(record, frames, 0, tick)
            shown = answers[step_m, runs.methods[0].name, ANY]
            record.log("answers", Answers(shown.truth_m, shown.answer_m, list(shown.verdict)), tick)

        rows = [_row(key, scored, places[key[0]], rng) for key, scored in answers.items()]
        times = [{"step_m": step_m, "method": name, "places": places[step_m], **cost._asdict()}
                 for (step_m, name), cost in costs.items()]  # fmt: skip
        _show_rates(record, rows)
        record.log("summary", Text(f"## Steps\n\n{markdown(columns_of(_short(rows)))}", markdown=True))
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}"))
        drawn = {"success": figures.success(rows), "heading_error": figures.heading_error(rows)}
        return Report(_metrics(rows), {"steps": columns_of(rows), "times": columns_of(times)}, drawn)


def _row(key: Key, scored: ScoredEstimates, places: int, rng: np.random.Generator) -> dict[str, Any]:
    step_m, method, headings = key
    nearest = scored.verdict == "nearest"
    low, high = bootstrap(lambda chosen: float(nearest[chosen].mean()), len(nearest), rng)
    return {
        "step_m": step_m,
        "method": method,
        "headings": headings,
        "places": places,
        "queries": len(nearest),
        **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
        "nearest_low": low,
        "nearest_high": high,
        "heading_error_mean_deg": float(np.mean(scored.heading_error_deg)),
        "heading_error_median_deg": float(np.median(scored.heading_error_deg)),
        "position_error_median_m": float(np.median(scored.error_m)),
    }


def _short(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What the viewer's table has room for."""
    kept = ("step_m", "method", "headings", "nearest_rate", "wrong_rate", "heading_error_median_deg")
    return [{name: row[name] for name in kept} for row in rows]


def _show_rates(record: Recorder, rows: Sequence[Mapping[str, Any]]) -> None:
    """A curve of nearest answers over the steps, for every method and kind of headings."""
    for name, headings in dict.fromkeys((row["method"], row["headings"]) for row in rows):
        rates = np.array([row["nearest_rate"] for row in rows if (row["method"], row["headings"]) == (name, headings)])
        steps = np.arange(len(rates))
        record.log(f"nearest/{key_of(name)}_{headings}", Series(rates, steps, STEP_NS * steps, "1"))


def _metrics(rows: Sequence[Mapping[str, Any]]) -> list[Metric]:
    """Rates of nearest answers and heading errors, by method, step and kind of headings."""
    found = []
    for row in rows:
        key = f"{key_of(row['method'])}_{row['step_m']:g}m_{row['headings']}"
        found.append(Metric(f"{key}_nearest_rate", row["nearest_rate"], "1", (row["nearest_low"], row["nearest_high"])))
        found.append(Metric(f"{key}_wrong_rate", row["wrong_rate"], "1"))
        if np.isfinite(row["heading_error_mean_deg"]):
            found.append(Metric(f"{key}_heading_error_mean", row["heading_error_mean_deg"], "deg"))
    return found
