"""What the numbers of a comparison mean, and which are the best."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from omnilab_serve.words import figure

CHANCE = 0.05  # from this p on a difference may well be chance
SMALL_IS_GOOD = re.compile(r"(^|_)error(_|$)")  # as `omnilab compare` counts the smaller error as won


def best_of(document: Mapping[str, Any], objective: str) -> dict[str, list[str]]:
    """By metric the letters of the configurations that are the best in it, where it is known which are.

    Errors are good if they are small. `objective`: a further METRIC of which the smallest is the best, or "-METRIC"
    of which the largest is.
    """
    found = {}
    for metric in (one["name"] for one in document["metrics"]):
        sign = {metric: 1, f"-{metric}": -1}.get(objective, 1 if SMALL_IS_GOOD.search(metric) else 0)
        means = {
            row["name"]: sign * row["metrics"][metric]["mean"]
            for row in document["configurations"]
            if sign and metric in row["metrics"] and row["metrics"][metric]["mean"] is not None
        }
        if len(means) > 1 and min(means.values()) < max(means.values()):
            found[metric] = [name for name, mean in means.items() if mean == min(means.values())]
    return found


def ordered(document: Mapping[str, Any], objective: str) -> Sequence[Mapping[str, Any]]:
    """The configurations, those first that are the best by an objective, those without a value last."""
    rows: Sequence[Mapping[str, Any]] = document["configurations"]
    metric, sign = objective.removeprefix("-"), -1 if objective.startswith("-") else 1

    def place(row: Mapping[str, Any]) -> tuple[bool, float]:
        mean = row["metrics"].get(metric, {}).get("mean")
        return mean is None, 0.0 if mean is None else sign * mean

    return sorted(rows, key=place) if objective else rows


def meaning_of(pair: Mapping[str, Any]) -> str:
    """What a paired difference says, in a sentence."""
    first, second, mean, p = pair["first"], pair["second"], pair["mean"], pair["permutation_p"]
    if mean is None or p is None:
        return "The errors are the same at every query." if pair["pairs"] == pair["tied"] else "Too few queries to say."
    which = f"{second} has {'smaller' if mean < 0 else 'larger'} errors than {first}, by {figure(abs(mean))} {pair['unit']} on average"
    if p < CHANCE:
        return f"{which}; chance alone would make as large a difference about {_times(p)}."
    return f"{which}, but chance alone may well do that: about {_times(p)}."


def _times(p: float) -> str:
    if p < 0.0015:
        return "once in 1000 times or less"
    if p < 0.01:
        return f"{p * 1000:.0f} times in 1000"
    return f"{p * 100:.2g} times in 100"
