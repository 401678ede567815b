"""Runs compared: what differs between their configurations, and their metrics, over seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnilab.errors import DataError
from omnilab.runner.compare.configurations import differences
from omnilab.runner.compare.gathering import ComparedRun, LeftOut, gather

if TYPE_CHECKING:
    from pandas import DataFrame

CONFIDENCE = 0.95
OVER_SEEDS, OF_RUN = "Student's t over seeds", "the run's own"  # what an interval is
LISTED = 8  # names in a sentence


@dataclass(frozen=True)
class RunComparison:
    """Runs in groups, of which each holds runs that are equal in everything but the seed."""

    runs: DataFrame  # a row a run: run, folder, seed, group
    values: DataFrame  # a row a run, a column a metric
    groups: DataFrame  # a row a group: the settings that differ, as texts; None where a run has no such setting
    statistics: DataFrame  # by group and metric: unit, n, mean, std, low, high, interval (OVER_SEEDS, OF_RUN or "")
    notes: list[str]  # what is to be known, in sentences
    left_out: list[LeftOut]

    @property
    def settings(self) -> list[str]:
        return list(self.groups.columns)

    @property
    def metrics(self) -> list[str]:
        """Those that at least two groups have, or all of a single group, in the order of the studies."""
        return list(self.statistics.index.unique("metric"))

    def wide(self, column: str) -> DataFrame:
        """One column of the statistics: a row a group, a column a metric."""
        return self.statistics[column].unstack("metric").reindex(self.groups.index)[self.metrics]

    def seeds(self) -> list[int]:
        """How many seeds each group has."""
        return [int(count) for count in self.runs.groupby("group").size().reindex(self.groups.index)]


def compare_runs(folders: Iterable[str | Path]) -> RunComparison:
    """Compare the finished runs in folders of runs and of sweeps.

    DataError if a folder holds none, or if none of the runs is finished.
    """
    found, left_out = gather(Path(folder) for folder in folders)
    if not found:
        why = "; ".join(f"{run.name} ({' '.join(filter(None, [run.state, run.why]))})" for run in left_out[:3])
        raise DataError(
            f"none of these runs can be compared: {why}; give runs that are done (`omnilab runs` lists them)"
        )
    runs, groups = _grouped(found)
    runs, notes = _once_a_seed(runs, found)
    wanted, more = _comparable(runs, found)
    values = _values(runs, found)
    statistics = _statistics(runs["group"], values[wanted], found)
    return RunComparison(runs, values, groups, statistics, [*notes, *more], left_out)


def _grouped(found: Sequence[ComparedRun]) -> tuple[DataFrame, DataFrame]:
    """The runs in groups of equal settings; and the settings of each group."""
    import pandas as pd

    settings = pd.DataFrame(differences([run.configuration for run in found]), index=range(len(found)), dtype=object)
    columns = list(settings.columns)
    number = settings.groupby(columns, dropna=False, sort=False).ngroup() if columns else 0
    head = {
        "run": [run.name for run in found],
        "folder": [run.folder for run in found],
        "seed": [r.seed for r in found],
    }
    runs = pd.DataFrame(head).assign(group=number)
    groups = settings[~runs["group"].duplicated()].reset_index(drop=True)
    return runs, groups.astype(object).where(groups.notna(), None)


def _once_a_seed(runs: DataFrame, found: Sequence[ComparedRun]) -> tuple[DataFrame, list[str]]:
    """The last run of each seed of a group: the same seed again is no second sample."""
    again = runs.duplicated(["group", "seed"], keep="last")
    if not again.any():
        return runs, []
    names = _list([found[i].name for i in runs.index[again]])
    return runs[~again], [f"runs of one configuration and one seed count once, the last of them; left out: {names}"]


def _comparable(runs: DataFrame, found: Sequence[ComparedRun]) -> tuple[list[str], list[str]]:
    """The metrics that can be compared, and sentences about the others."""
    first = runs[~runs["group"].duplicated()].index
    of_groups = [set(found[i].metrics) for i in first]
    names = list(dict.fromkeys(name for i in runs.index for name in found[i].metrics))
    units: dict[str, set[str]] = {}
    for i in first:
        for name, unit in found[i].units.items():
            units.setdefault(name, set()).add(unit)
    mixed = [name for name in names if len(units.get(name, ())) > 1]
    counts = {name: sum(name in metrics for metrics in of_groups) for name in names}
    alone = [name for name in names if counts[name] == 1 < len(of_groups)]
    some = [name for name in names if 1 < counts[name] < len(of_groups) and name not in mixed]
    notes = []
    if len(studies := {run.study for run in found}) > 1:
        notes.append(
            f"these are runs of different studies ({_list(sorted(studies))}): only metrics of one name are compared"
        )
    if alone:
        notes.append(f"not compared, for only one configuration has them: {_list(alone)}")
    if some:
        notes.append(f"missing in some of the configurations: {_list(some)}")
    if mixed:
        named = [f"{name} ({' or '.join(sorted(units[name]))})" for name in mixed]
        notes.append(f"not compared, for their units differ: {_list(named)}")
    return [name for name in names if name not in {*alone, *mixed}], notes


def _values(runs: DataFrame, found: Sequence[ComparedRun]) -> DataFrame:
    """The metrics of each run."""
    import pandas as pd

    return pd.DataFrame.from_records([found[i].metrics for i in runs.index], index=runs.index)


def _statistics(group: Any, metrics: DataFrame, found: Sequence[ComparedRun]) -> DataFrame:
    """Mean, standard deviation and interval of each metric over the runs of each group; of one run, its own interval."""
    import numpy as np
    import pandas as pd
    from scipy.special import stdtrit  # as scipy.stats.t.ppf, without a second of imports

    values = metrics.set_axis(group.rename("group")).rename_axis(columns="metric").stack(future_stack=True)
    table = values.groupby(level=["group", "metric"], sort=False).agg(n="count", mean="mean", std="std", sem="sem")
    half = stdtrit(np.maximum(table["n"] - 1, 1), (1 + CONFIDENCE) / 2) * table["sem"]
    table["low"], table["high"] = table["mean"] - half, table["mean"] + half
    table["interval"] = np.where(table["n"] > 1, OVER_SEEDS, "")
    alone = group[~group.duplicated(keep=False)]
    intervals = {
        (number, metric): interval for i, number in alone.items() for metric, interval in found[i].intervals.items()
    }
    keys = table.index.intersection(pd.MultiIndex.from_tuples(intervals or [(-1, "")], names=table.index.names))
    table.loc[keys, ["low", "high"]] = np.array([intervals[key] for key in keys]).reshape(-1, 2)
    table.loc[keys, "interval"] = OF_RUN
    units = {name: unit for run in reversed(found) for name, unit in run.units.items()}
    table.insert(0, "unit", [units[metric].replace("1", "", 1) for metric in table.index.get_level_values("metric")])
    return table.drop(columns="sem")


def _list(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
