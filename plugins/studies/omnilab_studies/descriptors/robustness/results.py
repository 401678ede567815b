"""Results of the study `robustness`: estimates of every method at every level, rates, areas, breakdown points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Metric
from omnilab.metrics import VERDICTS
from omnilab_studies.common.disturbance_levels import Level
from omnilab_studies.common.method_runs import MethodCost, MethodEstimates
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import UNDECIDED, ScoredEstimates, joined_estimates
from omnilab_studies.common.tables import columns_of

BROKEN = 0.5  # of the rate of clear queries


class Comparison:
    """The scored estimates of every method at every level."""

    def __init__(self, names: Sequence[str], levels: Sequence[Level]) -> None:
        self.names, self.levels = names, levels
        self.pictures: list[Bytes] = []  # of the first query, at each level
        self.fields: dict[str, Floats] = {}  # its clear distances to all places
        self._batches: dict[tuple[str, int], list[ScoredEstimates]] = {}

    def add(self, step: int, found: MethodEstimates) -> None:
        """Add the estimates of one method for a batch of queries at one level."""
        name, distances = found.method.name, found.estimates.field
        self._batches.setdefault((name, step), []).append(found.scored)
        if step == 0 and name not in self.fields and distances is not None:
            self.fields[name] = distances[0]

    def at(self, step: int) -> dict[str, ScoredEstimates]:
        """All estimates at one level, by method."""
        return {name: joined_estimates(self._batches.get((name, step), [])) for name in self.names}

    @cached_property
    def rates(self) -> dict[str, Floats]:
        """Rates of nearest estimates (levels,) of each method."""
        steps = [self.at(step) for step in range(len(self.levels))]
        return {name: np.array([float(np.mean(s[name].verdict == "nearest")) for s in steps]) for name in self.names}

    def area(self, name: str, disturbance: str | None = None) -> float:
        """Mean rate of nearest estimates over a disturbance's levels, or the mean of that over all disturbances."""
        disturbances = self.disturbances if disturbance is None else [disturbance]
        return float(np.mean([self.rates[name][self.steps_of(d)].mean() for d in disturbances]))

    def breakdown(self, name: str, disturbance: str) -> float | str:
        """The first level at which the rate is below half of the clear one; empty if there is none."""
        rates = self.rates[name]
        broken = [i for i in self.steps_of(disturbance) if rates[i] < BROKEN * rates[0]]
        return self.levels[broken[0]].value if broken else ""

    @property
    def disturbances(self) -> list[str]:
        """The names of the disturbances."""
        return list(dict.fromkeys(level.disturbance for level in self.levels[1:]))

    def steps_of(self, disturbance: str) -> list[int]:
        """The indices of a disturbance's levels."""
        return [i for i, level in enumerate(self.levels) if level.disturbance == disturbance]

    def table(self) -> dict[str, list[Any]]:
        """The table `levels`: one row a method and level."""
        rows = [_row(name, level, self.at(i)[name]) for i, level in enumerate(self.levels) for name in self.names]
        return columns_of(rows)


def _row(name: str, level: Level, scored: ScoredEstimates) -> dict[str, Any]:
    return {
        "method": name,
        "disturbance": level.disturbance,
        "setting": level.setting,
        "level": level.value,
        "queries": len(scored.verdict),
        **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
        "heading_error_median_deg": of_known(np.median, scored.heading_error_deg),
        "heading_error_p95_deg": of_known(partial(np.quantile, q=0.95), scored.heading_error_deg),
        "position_error_mean_m": float(scored.error_m.mean()),
        "sharpness_mean": float(scored.sharpness.mean()),
    }


def summary_of(comparison: Comparison, costs: Mapping[str, MethodCost]) -> list[dict[str, Any]]:
    """The table `robustness`: one row a method, with the sharpness C of clear queries (thesis, eq. 4.6)."""
    clear = comparison.at(0)
    return [
        {
            "method": name,
            "clear_rate": float(np.mean(clear[name].verdict == "nearest")),
            "area": comparison.area(name),
            **{f"area_{d}": comparison.area(name, d) for d in comparison.disturbances},
            **{f"breakdown_{d}": comparison.breakdown(name, d) for d in comparison.disturbances},
            "sharpness": float(clear[name].sharpness.mean()),
            "heading_error_median_deg": of_known(np.median, clear[name].heading_error_deg),
            "bytes_per_place": costs[name].bytes_per_place,
            "describe_ms": costs[name].describe_ms,
            "locate_ms": costs[name].locate_ms,
        }
        for name in comparison.names
    ]


def metrics_of(comparison: Comparison, costs: Mapping[str, MethodCost]) -> list[Metric]:
    """The metrics, areas first: tables of runs show these."""
    found = [Metric(f"{key_of(name)}_area", comparison.area(name), "1") for name in comparison.names]
    for name, scored in comparison.at(0).items():
        key = key_of(name)
        found.append(Metric(f"{key}_clear_rate", float(comparison.rates[name][0]), "1"))
        found += [Metric(f"{key}_area_{d}", comparison.area(name, d), "1") for d in comparison.disturbances]
        if scored.has_headings:
            error = of_known(np.median, scored.heading_error_deg)
            found.append(Metric(f"{key}_heading_error_median", error, "deg", note=UNDECIDED))
        if np.isfinite(scored.sharpness).all():
            found.append(Metric(f"{key}_sharpness_mean", float(scored.sharpness.mean()), "1"))
        found.append(Metric(f"{key}_bytes_per_place", costs[name].bytes_per_place, "B"))
    return found


def markdown_of(summary: Sequence[Mapping[str, Any]], levels: Sequence[Level], rates: Mapping[str, Floats]) -> str:
    """The summary: rates at every level, and the rest of the table `robustness`."""
    names = [str(row["method"]) for row in summary]
    lines = ["## Robustness", "", f"| nearest | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for i, level in enumerate(levels):
        lines.append(f"| {level.title} | {' | '.join(f'{rates[name][i]:.3f}' for name in names)} |")
    lines += ["", f"| | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for key in list(summary[0])[1:]:
        cells = [f"{row[key]:.3g}" if isinstance(row[key], float) else f"{row[key] or '–'}" for row in summary]
        lines.append(f"| {key.replace('_', ' ')} | {' | '.join(cells)} |")
    return "\n".join(lines)
