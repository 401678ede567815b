"""Time and memory of a component, beside those of the built-in ones of its kind."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from omnilab.errors import OmnilabError
from omnilab.runner.plugins.finding import own_distributions
from omnilab.runner.registry import Registry
from omnilab.testing.by_kind import TRIALS
from omnilab.testing.rules import Trial, Work

LONG_S = 0.1  # a call is repeated until they take so long together
REPEATS = 20  # at most


@dataclass(frozen=True)
class MeasuredCost:
    """What a component takes for one unit of its work: the least of several calls, and the peak of one."""

    seconds: float
    bytes: float  # that Python and numpy hold at once beside what is there before


def cost_of(trial: Trial) -> tuple[MeasuredCost, str] | None:
    """MeasuredCost and unit of a component's work; None of one of which nothing is measured."""
    work = trial.work()
    if work is None:
        return None
    work.call()  # imports and compiles what it needs
    return MeasuredCost(_seconds(work) / work.count, _peak(work) / work.count), work.unit


def _seconds(work: Work) -> float:
    taken: list[float] = []
    while sum(taken) < LONG_S and len(taken) < REPEATS:
        start = time.perf_counter()
        work.call()
        taken.append(time.perf_counter() - start)
    return min(taken)


def _peak(work: Work) -> int:
    tracemalloc.start()
    try:
        held, _ = tracemalloc.get_traced_memory()
        result = work.call()
        _, peak = tracemalloc.get_traced_memory()
        del result
    finally:
        tracemalloc.stop()
    return max(0, peak - held)


def built_in_costs(kind: str, registry: Registry) -> Mapping[str, MeasuredCost]:
    """MeasuredCost of each built-in component of a kind with its default settings, but for those that need a file."""
    own, found = own_distributions(), dict[str, MeasuredCost]()
    for component in registry.components.values():
        if component.kind != kind or component.plugin.distribution not in own:
            continue
        try:
            cost = cost_of(TRIALS[kind](component.cls()))
        except OmnilabError:  # it needs a setting
            continue
        if cost is not None:
            found[component.name] = cost[0]
    return found


def medians(costs: Sequence[MeasuredCost]) -> MeasuredCost:
    """The median of each."""
    return MeasuredCost(median(cost.seconds for cost in costs), median(cost.bytes for cost in costs))
