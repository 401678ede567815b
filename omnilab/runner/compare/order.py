"""The order of the configurations of a comparison: by a setting, or the best first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from omnilab.errors import ConfigError, did_you_mean
from omnilab.runner.compare.comparison import RunComparison

if TYPE_CHECKING:
    from pandas import DataFrame


def by_setting(comparison: RunComparison, path: str) -> RunComparison:
    """Configurations by the value of one setting, the others held fixed as long as it runs; it is their last column.

    ConfigError if it is no setting in which they differ.
    """
    checked([path], comparison.settings, "setting that differs")
    settings = [name for name in comparison.settings if name != path] + [path]
    groups = comparison.groups[settings]
    return _ordered(replace(comparison, groups=groups), sorted_groups(groups, settings))


def sorted_groups(groups: DataFrame, settings: Sequence[str]) -> list[int]:
    """The configurations in the order of the values of settings, the first of which changes last."""
    keys = {group: [value_order(row[name]) for name in settings] for group, row in groups.iterrows()}
    return sorted(keys, key=keys.__getitem__)


def best_first(comparison: RunComparison, objective: str) -> RunComparison:
    """Configurations by the mean of a metric, the smallest first, of "-METRIC" the largest; those without a value last.

    ConfigError if there is no such metric.
    """
    metric = objective.removeprefix("-")
    checked([metric], comparison.metrics, "metric of these runs")
    sign = -1 if objective.startswith("-") else 1
    means = comparison.wide("mean")[metric]
    return _ordered(comparison, sorted(means.index, key=lambda group: _missing_last(sign * means[group])))


def checked(names: Sequence[str], known: Sequence[str], what: str) -> None:
    """ConfigError for the first name that is not known."""
    for name in names:
        if name not in known:
            there_is = f"there is {', '.join(known)}" if known else "there is none"
            raise ConfigError(f"'{name}' is no {what}; {there_is}" + did_you_mean(name, known))


def value_order(value: str | None) -> tuple[int, float, str]:
    """Numbers by their size, then texts, then what has no value."""
    if value is None:
        return 2, 0.0, ""
    try:
        return 0, float(value), ""
    except ValueError:
        return 1, 0.0, value


def _missing_last(value: float) -> tuple[bool, float]:
    return math.isnan(value), value


def _ordered(comparison: RunComparison, groups: Sequence[int]) -> RunComparison:
    """The same with its groups in another order, and numbered by it."""
    number = {group: i for i, group in enumerate(groups)}
    return replace(
        comparison,
        runs=comparison.runs.assign(group=comparison.runs["group"].map(number)),
        groups=comparison.groups.loc[list(groups)].reset_index(drop=True),
        statistics=comparison.statistics.rename(index=number, level="group"),
    )
