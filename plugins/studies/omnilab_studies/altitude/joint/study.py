"""Position and height at once, from one map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from omnilab.api import Floats, Metric, Parts, PlaceMap, Plan, RandomPoses, Recorder, Report, Series, Text, Tick
from omnilab.errors import ConfigError
from omnilab.metrics import bootstrap
from omnilab_studies.altitude.joint import figures
from omnilab_studies.altitude.joint.layout import LAYOUT
from omnilab_studies.common.describing import describe, describe_places, fitted
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.grids import check_extent, check_step, grid_poses
from omnilab_studies.common.localization_run import LocalizationRun, estimate_of
from omnilab_studies.common.logs import show_frame
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, score
from omnilab_studies.common.tables import columns_of, markdown

OFFSET_NS = 100_000_000  # between two heights, in the logs
LEVEL_M = 0.05  # rises below it have no sign that one could miss


@dataclass
class Joint:
    """Localise above and below a map, and tell the height there: the answered place is the altimeter's reference.

    The map lies at one height; queries are at random poses at each of `offsets_m` above it. How far the answers stay
    right as the queries leave the map's height, and what the altimeter makes of the answered place's image: the sign, and
    after one scale for all queries the error in metres (Berenguer, thesis, 7.2, names it as future work).
    """

    step_m: float = 0.4  # of the grid of places
    extent_m: list[float] | None = None  # x and y size of the grid; null: all that the sensor covers
    height_m: float = 0.6  # of the map
    offsets_m: list[float] = field(
        default_factory=lambda: [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.5]
    )  # of the queries
    query_count: int = 60  # at each height

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer", "altimeter")

    def __post_init__(self) -> None:
        check_step(self.step_m)
        check_extent(self.extent_m)
        if self.query_count < 1:
            raise ConfigError(f"study.query_count={self.query_count} asks nothing; give 1 or more")
        if not self.offsets_m or self.height_m + min(self.offsets_m) <= 0:
            raise ConfigError(
                f"study.offsets_m={self.offsets_m} leave nothing above the floor from a map at {self.height_m:g} m; give"
                " some, each above minus that"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map at one height; ask at others; from the answered place, tell how much higher."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        seed = int(rng.integers(2**32))
        extent = None if self.extent_m is None else (self.extent_m[0], self.extent_m[1])
        plans = [
            parts.sensor.plan(RandomPoses(self.query_count, seed + i, None, extent, self.height_m + offset))
            for i, offset in enumerate(self.offsets_m)
        ]
        grid = parts.sensor.plan(grid_poses(self.step_m, None, self.extent_m, self.height_m))
        parts = fitted(parts, grid, record)
        places, omitted = describe_places(parts, grid, record)
        run = LocalizationRun(parts, places, record, show=0)
        record.log("places", PlaceMap(run.places_m))

        asked = []
        for step, (offset_m, plan) in enumerate(zip(self.offsets_m, plans, strict=True)):
            asked.append(self._ask(parts, run, plan, offset_m, int(rng.integers(2**32)), step))
            omitted += plan.omitted
        scale = _scale(asked)
        rows = [_row(one, scale, self.step_m, rng) for one in asked]
        for step, row in enumerate(rows):
            at = np.array([step]), np.array([OFFSET_NS * step])
            record.log("nearest", Series(np.array([row["nearest_rate"]]), *at, "1"))
            for name in ("offset_m", "told_median_m"):
                record.log(f"height/{name}", Series(np.array([row[name]]), *at, "m"))
        record.log("summary", Text(f"## Position and height\n\n{markdown(columns_of(rows))}", markdown=True))
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}"))
        table = {"joint": columns_of(rows), "queries": _table(asked, scale)}
        return Report(_metrics(rows, asked, scale), table, {"joint": figures.joint(rows, _pairs(asked, scale))})

    def _ask(self, parts: Parts, run: LocalizationRun, plan: Plan, offset_m: float, seed: int, step: int) -> Asked:
        """The answers to the queries of one height, and what the altimeter says of each."""
        scored, told, unit = [], [], ""
        for frames in deliver_queries(parts, plan, run.record, seed):
            signatures = describe(parts.descriptor, frames, run.record)
            scored.append(score(frames, run.locate(signatures), run.places_m, run.step_m))
            with run.record.timed("height", len(frames)):
                heights = parts.altimeter.relative(run.pictures(scored[-1].place), frames.images, frames.camera)
            told.append(heights.value)
            unit = heights.unit
            if len(scored) == 1:
                tick = Tick(step, OFFSET_NS * step)
                show_frame(run.record, frames, 0, signatures.place[0], tick)
                run.record.log("estimate", estimate_of(scored[0], 0), tick)
        whole = joined_estimates(scored)
        return Asked(offset_m, whole, np.concatenate(told), whole.truth_m[:, 2] - run.places_m[whole.place, 2], unit)


class Asked(NamedTuple):
    """The answers at one height."""

    offset_m: float
    scored: ScoredEstimates
    told: Floats  # (Q,) in the altimeter's unit, NaN where it could not tell
    rise_m: Floats  # (Q,) how much higher than the answered place the query was taken
    unit: str


def _scale(asked: Sequence[Asked]) -> float:
    """Metres per unit of the altimeter: 1 where it tells metres, else the least squares over all queries."""
    if asked[0].unit == "m":
        return 1.0
    told, rise = (np.concatenate(parts) for parts in zip(*((one.told, one.rise_m) for one in asked), strict=True))
    known = np.isfinite(told)
    square = float(told[known] @ told[known])
    return float(told[known] @ rise[known]) / square if square > 0 else float("nan")


def _row(asked: Asked, scale: float, step_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """One height."""
    nearest = asked.scored.verdict == "nearest"
    low, high = bootstrap(lambda chosen: float(nearest[chosen].mean()), len(nearest), rng)
    told = scale * asked.told
    away = np.linalg.norm(asked.scored.answer_m[:, :2] - asked.scored.truth_m[:, :2], axis=1)
    return {
        "offset_m": asked.offset_m,
        "queries": len(nearest),
        "nearest_rate": float(nearest.mean()),
        "nearest_low": low,
        "nearest_high": high,
        "within_step_rate": float((away <= step_m).mean()),
        "position_error_median_m": float(np.median(away)),
        "heading_error_median_deg": float(np.median(asked.scored.heading_error_deg)),
        "told_median_m": _nanmedian(told),
        "height_error_median_m": _nanmedian(np.abs(told - asked.rise_m)),
        "sign_rate": _signs(asked),
        "not_told": int(np.isnan(told).sum()),
    }


def _nanmedian(values: Floats) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def _signs(asked: Asked) -> float:
    """Share of right signs; NaN for queries at the map's own height."""
    if abs(asked.offset_m) < LEVEL_M:
        return float("nan")
    return float((np.sign(asked.told) == np.sign(asked.rise_m)).mean())


def _metrics(rows: Sequence[Mapping[str, Any]], asked: Sequence[Asked], scale: float) -> list[Metric]:
    """Over all heights first, then height by height."""
    near, away = ([r for r in rows if (abs(r["offset_m"]) < LEVEL_M) is level] for level in (True, False))
    error = np.concatenate([np.abs(scale * one.told - one.rise_m) for one in asked])
    found = [
        Metric("nearest_rate", float(np.mean([row["nearest_rate"] for row in rows])), "1"),
        Metric("height_error_median", _nanmedian(error), "m"),
    ]
    if away:
        found.append(Metric("sign_rate", float(np.mean([row["sign_rate"] for row in away])), "1"))
    if near:
        found.append(Metric("nearest_rate_level", float(np.mean([row["nearest_rate"] for row in near])), "1"))
    if asked[0].unit != "m":
        found.append(Metric("scale", scale, f"m/{asked[0].unit}"))
    for row in rows:
        key = f"{row['offset_m']:+g}m"
        found.append(Metric(f"nearest_rate_{key}", row["nearest_rate"], "1", (row["nearest_low"], row["nearest_high"])))
        found.append(Metric(f"height_error_median_{key}", row["height_error_median_m"], "m"))
    return found


def _pairs(asked: Sequence[Asked], scale: float) -> tuple[Floats, Floats]:
    """True and told rises (N,) in metres, of all queries."""
    return np.concatenate([one.rise_m for one in asked]), scale * np.concatenate([one.told for one in asked])


def _table(asked: Sequence[Asked], scale: float) -> dict[str, list[Any]]:
    """One row a query."""
    rise, told = _pairs(asked, scale)
    verdict = np.concatenate([one.scored.verdict for one in asked])
    offset = np.concatenate([np.full(len(one.told), one.offset_m) for one in asked])
    return {
        "offset_m": offset.tolist(),
        "verdict": verdict.tolist(),
        "rise_m": rise.tolist(),
        "told_m": told.tolist(),
    }
