"""The objective of a run: the metrics that it returns to a sweeper, which looks for their least or greatest values.

A study may declare its metrics, `metric_names`: names, with words in capitals for what depends on components, as in
`METHOD_nearest_rate`. Then a misspelt objective is refused before anything runs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab.errors import ConfigError, did_you_mean

LEAST = {"places": 2, "queries": 1}  # metrics that count; with fewer, every answer is right or there is none

Value = float | tuple[float, ...] | str  # what a sweeper is given; a text says why a run is no candidate


class Goal(NamedTuple):
    """One metric of an objective."""

    metric: str
    sign: int  # -1 where its negative is returned

    @property
    def name(self) -> str:
        return self.metric if self.sign > 0 else f"-{self.metric}"


def goals_of(objective: Any) -> list[Goal]:
    """The metrics that the setting `objective` names, each once; ConfigError if it names none."""
    words = objective if isinstance(objective, Sequence) and not isinstance(objective, str) else [objective]
    if not words or not all(isinstance(word, str) and re.fullmatch(r"-?[^\s-]\S*", word) for word in words):
        raise ConfigError(
            f"objective={objective} names no metric; give objective=METRIC, objective=-METRIC for its negative, or"
            " objective=[METRIC,METRIC] for several"
        )
    goals = [Goal(word.removeprefix("-"), -1 if word.startswith("-") else 1) for word in words]
    if len({goal.metric for goal in goals}) < len(goals):
        raise ConfigError(f"objective={objective} names a metric twice; give each once")
    return goals


def check_objective(objective: Any, study: Any) -> None:
    """ConfigError for an objective that a study does not measure. Of one that does not say, it shows after its run."""
    goals = [] if objective is None else goals_of(objective)
    declared = getattr(study, "metric_names", ())
    for goal in goals:
        if declared and not is_declared(goal.metric, declared):
            raise ConfigError(_unknown(goal.metric, declared))


def check_sweep(config: DictConfig) -> None:
    """The same before the jobs of a sweep, where neither objective nor study differ between them."""
    try:
        study = None if OmegaConf.is_missing(config, "study") else config.study
        objective = plain(config.objective)
    except OmegaConfBaseException:  # which the jobs come upon
        return
    if isinstance(study, DictConfig):
        check_objective(objective, OmegaConf.get_type(study))


def is_declared(metric: str, declared: Iterable[str]) -> bool:
    """Whether a metric is one of those that a study declares."""
    return any(pattern_of(name).fullmatch(metric) for name in declared)


def pattern_of(name: str) -> re.Pattern[str]:
    """What a declared name stands for: itself, with anything in place of each word in capitals."""
    return re.compile(".+".join(re.escape(part) for part in re.split(r"(?<![^_])[A-Z]+(?![^_])", name)))


def value_of(objective: Any, metrics: Mapping[str, float]) -> Value:
    """What a run with these metrics returns to a sweeper; a sentence if it is no candidate.

    Without an objective it is the first metric. ConfigError if a metric that is wanted was not measured.
    """
    objective = plain(objective)
    goals = goals_of(next(iter(metrics), None) if objective is None else objective) if metrics else []
    for goal in goals:
        if goal.metric not in metrics:
            raise ConfigError(_unknown(goal.metric, list(metrics)))
    for name, least in LEAST.items():
        if metrics.get(name, least) < least:
            return f"with {metrics[name]:g} {name} there is no answer that could be wrong"
    values = tuple(goal.sign * metrics[goal.metric] for goal in goals)
    without = [goal.metric for goal, value in zip(goals, values, strict=True) if not math.isfinite(value)]
    if without or not values:
        return f"{', '.join(without) or 'the run'} has no value"
    return values if isinstance(objective, list) else values[0]


def described(objective: Any, value: Value) -> str:
    """The objective of one run, in a line."""
    if isinstance(value, str):
        return f"no objective: {value}"
    values = value if isinstance(value, tuple) else (value,)
    names = [goal.name for goal in goals_of(plain(objective))]
    return f"objective: {', '.join(f'{name} = {one:.6g}' for name, one in zip(names, values, strict=True))}"


def plain(objective: Any) -> Any:
    """The setting as texts and lists, not as nodes of a configuration."""
    return OmegaConf.to_container(objective) if OmegaConf.is_config(objective) else objective


def _unknown(metric: str, known: Sequence[str]) -> str:
    return f"objective: the study has no metric '{metric}'; it has {', '.join(known)}{did_you_mean(metric, known)}"
