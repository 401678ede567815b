"""Study F: contestants on disturbed queries, level by level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from omnilab.api import (
    Bytes,
    Disturbance,
    Estimate,
    Floats,
    Frames,
    Metric,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
)
from omnilab.errors import ConfigError, did_you_mean
from omnilab.geometry import heading_of
from omnilab.metrics import VERDICTS
from omnilab_studies import robustness_figures as figures
from omnilab_studies.common import deliver, disturbed, show_picture
from omnilab_studies.layouts import LEVELS
from omnilab_studies.rivals import Answered, Cost, Rivals
from omnilab_studies.scoring import Scored, joined
from omnilab_studies.square import check_square, free_square, headed, positions_within

LEVEL_NS = 100_000_000  # between two levels, in the logs
BROKEN = 0.5  # of the rate of clear queries


class Level(NamedTuple):
    """A disturbance at one strength; none at all is the level "clear"."""

    disturbance: str
    setting: str = ""
    value: float | str = ""
    applied: Mapping[str, Disturbance] = {}

    @property
    def title(self) -> str:
        return f"{self.disturbance} {self.value:g}" if isinstance(self.value, float | int) else self.disturbance


@dataclass
class Robustness:
    """Study F: how the answers of several descriptors fare as queries get worse (Berenguer, thesis, 4.6.5, fig. 4.23).

    `side` x `side` places; the same queries, spoilt in the same way, for every contestant: clear, then by each of the
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
        for name, settings in self.levels.items():
            if len(settings) != 1 or not all(_are_numbers(values) for values in settings.values()):
                raise ConfigError(
                    f"study.levels.{name}={settings} is not one setting with numbers; give {{SETTING: [NUMBER, ...]}}"
                )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map, spoil, localise, score."""
        record.log("", LEVELS)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        levels = self._levels(parts.disturbances, record)

        # the map: described by every contestant
        grid = free_square(parts.sensor, self.side, self.step_m, self.center_m, self.height_m)
        places_m = _positions(grid)
        record.log("places", PlaceMap(places_m))
        at = positions_within(grid, self.query_count, rng)
        plan = parts.sensor.plan(headed(at, rng.random(self.query_count), self.heading_steps))
        seed = int(rng.integers(2**32))
        rivals = Rivals(parts, grid, record)

        # the queries: each batch is imaged once, then spoilt and answered at every level
        outcome = _Outcome([c.name for c in rivals.contestants], levels)
        for frames in deliver(parts, plan, record, "queries"):
            for step, level in enumerate(levels):
                with record.timed("disturb", len(frames)):
                    spoilt = disturbed(frames, level.applied, seed)
                for answered in rivals.answers(spoilt):
                    outcome.take(step, answered)
                    if 0 in frames.plan_index:
                        _show_answer(record, step, answered)
                if 0 in frames.plan_index:
                    outcome.pictures.append(spoilt.images[0])
                    _show_query(record, step, level, spoilt)
        costs = {c.name: rivals.cost(c) for c in rivals.contestants}

        # what it amounts to
        steps = np.arange(len(levels))
        for name, rates in outcome.rates.items():
            record.log(f"nearest/{_key(name)}", Series(rates, steps, LEVEL_NS * steps, "1"))
        summary = _summary(outcome, costs)
        record.log("summary", Text(_markdown(summary, levels, outcome.rates), markdown=True))
        tables = {"robustness": _columns(summary), "levels": outcome.table()}
        return Report(_metrics(outcome, costs), tables, self._figures(outcome, costs, places_m))

    def _levels(self, disturbances: Mapping[str, Disturbance], record: Recorder) -> list[Level]:
        """Clear, and every level of every disturbance; one without `levels` has its own strength alone."""
        for name in self.levels.keys() - disturbances.keys():
            record.log("log", Text(f"study.levels.{name} is not used: the run has no disturbance '{name}'"))
        found = [Level("clear")]
        for name, disturbance in disturbances.items():
            if name not in self.levels:
                found.append(Level(name, applied={name: disturbance}))
                continue
            ((setting, values),) = self.levels[name].items()
            found += [Level(name, setting, v, {name: _at(disturbance, name, setting, v)}) for v in values]
        return found

    def _figures(self, outcome: _Outcome, costs: Mapping[str, Cost], places_m: Floats) -> dict[str, Any]:
        clear = outcome.at(0)
        areas = {name: outcome.area(name) for name in outcome.names}
        first = next(iter(clear.values()))
        sharpness = {name: scored.sharpness for name, scored in clear.items() if np.isfinite(scored.sharpness).all()}
        drawn = {
            "pictures": figures.pictures(outcome.pictures, outcome.levels),
            "rates": figures.rates(outcome.rates, outcome.levels, self.query_count),
            "pareto": figures.pareto(costs, areas, "mean rate of nearest answers over all levels"),
        }
        if sharpness:
            drawn["sharpness"] = figures.sharpness(sharpness)
        if outcome.fields:
            drawn["surfaces"] = figures.surfaces(places_m, outcome.fields, first.truth_m[0])
        return drawn


def _are_numbers(values: Sequence[Any]) -> bool:
    """Whether there are some, whole or not: whole ones are no floats to OmegaConf, so the field cannot say it."""
    return len(values) > 0 and all(isinstance(value, int | float) for value in values)


def _at(disturbance: Any, name: str, setting: str, value: float) -> Disturbance:
    """A disturbance with one setting changed."""
    known = [f.name for f in fields(disturbance)]
    if setting not in known:
        raise ConfigError(
            f"study.levels.{name} varies '{setting}', which is no setting of {name}; there is {', '.join(known)}"
            f"{did_you_mean(setting, known)}"
        )
    whole = isinstance(getattr(disturbance, setting), int)
    changed: Disturbance = replace(disturbance, **{setting: int(value) if whole else float(value)})
    return changed


class _Outcome:
    """The answers of every contestant at every level."""

    def __init__(self, names: Sequence[str], levels: Sequence[Level]) -> None:
        self.names, self.levels = names, levels
        self.pictures: list[Bytes] = []  # of the first query, at each level
        self.fields: dict[str, Floats] = {}  # its clear distances to all places
        self._batches: dict[tuple[str, int], list[Scored]] = {}

    def take(self, step: int, answered: Answered) -> None:
        name, distances = answered.contestant.name, answered.estimates.field
        self._batches.setdefault((name, step), []).append(answered.scored)
        if step == 0 and name not in self.fields and distances is not None:
            self.fields[name] = distances[0]

    def at(self, step: int) -> dict[str, Scored]:
        """All answers at one level, by contestant."""
        return {name: joined(self._batches.get((name, step), [])) for name in self.names}

    @cached_property
    def rates(self) -> dict[str, Floats]:
        """Rates of nearest answers (levels,) of each contestant."""
        steps = [self.at(step) for step in range(len(self.levels))]
        return {name: np.array([float(np.mean(s[name].verdict == "nearest")) for s in steps]) for name in self.names}

    def area(self, name: str, disturbance: str | None = None) -> float:
        """Mean rate of nearest answers over a disturbance's levels, or the mean of that over all disturbances."""
        disturbances = self.disturbances if disturbance is None else [disturbance]
        return float(np.mean([self.rates[name][self.steps_of(d)].mean() for d in disturbances]))

    def breakdown(self, name: str, disturbance: str) -> float | str:
        """The first level at which the rate is below half of the clear one; empty if there is none."""
        rates = self.rates[name]
        broken = [i for i in self.steps_of(disturbance) if rates[i] < BROKEN * rates[0]]
        return self.levels[broken[0]].value if broken else ""

    @property
    def disturbances(self) -> list[str]:
        return list(dict.fromkeys(level.disturbance for level in self.levels[1:]))

    def steps_of(self, disturbance: str) -> list[int]:
        return [i for i, level in enumerate(self.levels) if level.disturbance == disturbance]

    def table(self) -> dict[str, list[Any]]:
        """One row a contestant and level."""
        rows = [_row(name, level, self.at(i)[name]) for i, level in enumerate(self.levels) for name in self.names]
        return _columns(rows)


def _row(name: str, level: Level, scored: Scored) -> dict[str, Any]:
    return {
        "contestant": name,
        "disturbance": level.disturbance,
        "setting": level.setting,
        "level": level.value,
        "queries": len(scored.verdict),
        **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
        "heading_error_median_deg": float(np.median(scored.heading_error_deg)),
        "heading_error_p95_deg": float(np.quantile(scored.heading_error_deg, 0.95)),
        "position_error_mean_m": float(scored.error_m.mean()),
        "sharpness_mean": float(scored.sharpness.mean()),
    }


def _key(name: str) -> str:
    """A contestant's name as a part of others."""
    return name.replace(" + ", "_")


def _columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    return {key: [row[key] for row in rows] for key in rows[0]}


def _summary(outcome: _Outcome, costs: Mapping[str, Cost]) -> list[dict[str, Any]]:
    """One row a contestant."""
    clear = outcome.at(0)
    return [
        {
            "contestant": name,
            "clear_rate": float(np.mean(clear[name].verdict == "nearest")),
            "area": outcome.area(name),
            **{f"area_{d}": outcome.area(name, d) for d in outcome.disturbances},
            **{f"breakdown_{d}": outcome.breakdown(name, d) for d in outcome.disturbances},
            "sharpness": float(clear[name].sharpness.mean()),
            "heading_error_median_deg": float(np.median(clear[name].heading_error_deg)),
            "bytes_per_place": costs[name].bytes_per_place,
            "describe_ms": costs[name].describe_ms,
            "locate_ms": costs[name].locate_ms,
        }
        for name in outcome.names
    ]


def _metrics(outcome: _Outcome, costs: Mapping[str, Cost]) -> list[Metric]:
    """Areas first: they are what tables of runs show."""
    found = [Metric(f"{_key(name)}_area", outcome.area(name), "1") for name in outcome.names]
    for name, scored in outcome.at(0).items():
        key = _key(name)
        found.append(Metric(f"{key}_clear_rate", float(outcome.rates[name][0]), "1"))
        found += [Metric(f"{key}_area_{d}", outcome.area(name, d), "1") for d in outcome.disturbances]
        if scored.has_headings:
            error = float(np.median(scored.heading_error_deg))
            found.append(Metric(f"{key}_heading_error_median", error, "deg"))
        if np.isfinite(scored.sharpness).all():
            found.append(Metric(f"{key}_sharpness_mean", float(scored.sharpness.mean()), "1"))
        found.append(Metric(f"{key}_bytes_per_place", costs[name].bytes_per_place, "B"))
    return found


def _markdown(summary: Sequence[Mapping[str, Any]], levels: Sequence[Level], rates: Mapping[str, Floats]) -> str:
    """Rates of every level, and the rest of what was found."""
    names = [str(row["contestant"]) for row in summary]
    lines = ["## Robustness", "", f"| nearest | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for i, level in enumerate(levels):
        lines.append(f"| {level.title} | {' | '.join(f'{rates[name][i]:.3f}' for name in names)} |")
    lines += ["", f"| | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for key in list(summary[0])[1:]:
        cells = [f"{row[key]:.3g}" if isinstance(row[key], float) else f"{row[key] or '–'}" for row in summary]
        lines.append(f"| {key.replace('_', ' ')} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _show_query(record: Recorder, step: int, level: Level, spoilt: Frames) -> None:
    """The first query's picture at a level."""
    tick = Tick(step, LEVEL_NS * step)
    show_picture(record, spoilt, 0, tick)
    record.log("log", Text(level.title), tick)


def _show_answer(record: Recorder, step: int, answered: Answered) -> None:
    """Where a contestant takes the first query to be."""
    scored = answered.scored
    heading = float(scored.answer_heading_rad[0])
    truth_heading = float(heading_of(scored.truth[0]))
    estimate = Estimate(
        scored.truth_m[0], scored.answer_m[0], str(scored.verdict[0]),
        truth_heading, heading if np.isfinite(heading) else None,
    )  # fmt: skip
    record.log(f"estimate/{_key(answered.contestant.name)}", estimate, Tick(step, LEVEL_NS * step))


def _positions(plan: Plan) -> Floats:
    assert plan.T_world_camera is not None
    return plan.T_world_camera[:, :3, 3]
