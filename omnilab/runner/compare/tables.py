"""Comparisons as tables, for people and for files: CSV, LaTeX, Markdown."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnilab.errors import visible
from omnilab.runner.compare.comparison import OF_RUN, OVER_SEEDS, RunComparison
from omnilab.runner.compare.paired import RESAMPLES, PairedErrors, named
from omnilab.runner.run_folder.tables import write_text

if TYPE_CHECKING:
    from pandas import DataFrame

NOTHING = "–"
MARKDOWN = re.compile(r"([\\`*_{}\[\]<>()#+!|~$&])")
FEW_NAMES = 4  # runs of a configuration that are named


def configuration_table(comparison: RunComparison) -> DataFrame:
    """What differs: a row a setting, a column a configuration; below, its runs."""
    import pandas as pd

    table = pd.DataFrame({"what differs": [*comparison.settings, "runs", "seeds"]})
    for group, runs in comparison.runs.groupby("group"):
        settings = comparison.groups.loc[group].fillna(NOTHING)
        table[named(group)] = [*settings, _few(runs["run"].tolist()), _few(runs["seed"].tolist())]
    return table


def metric_table(comparison: RunComparison, metrics: Sequence[str]) -> DataFrame:
    """A row a metric, a column a configuration."""
    import pandas as pd

    statistics = comparison.statistics
    table = pd.DataFrame({"metric": metrics, "unit": [_unit(comparison, metric) for metric in metrics]})
    for group, seeds in zip(comparison.groups.index, comparison.seeds(), strict=True):
        found = statistics.xs(group, level="group").reindex(metrics)
        table[named(group)] = [full_text(row, seeds) for row in found.itertuples()]
    return table


def group_table(comparison: RunComparison, metrics: Sequence[str]) -> DataFrame:
    """A row a configuration: the settings that differ, its runs or how many seeds, and metrics."""
    import pandas as pd

    seeds = comparison.seeds()
    several = max(seeds) > 1
    names = comparison.runs.drop_duplicates("group").set_index("group")["run"].reindex(comparison.groups.index)
    columns = [] if several else [("run", names.tolist())]
    columns += [(name, values.fillna(NOTHING).tolist()) for name, values in comparison.groups.items()]
    columns += [("seeds", [str(count) for count in seeds])] if several else []
    for metric in metrics:
        unit = _unit(comparison, metric)
        found = comparison.statistics.xs(metric, level="metric").reindex(comparison.groups.index)
        texts = [short_text(row, count) for row, count in zip(found.itertuples(), seeds, strict=True)]
        columns.append((f"{metric} [{unit}]" if unit else metric, texts))
    table = pd.DataFrame(dict(enumerate(values for _, values in columns)))
    table.columns = [name for name, _ in columns]  # of which two may be the same
    return table


def paired_table(pairs: Sequence[PairedErrors]) -> DataFrame:
    """A row a kind of errors of two configurations."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "configurations": f"{named(pair.second)} - {named(pair.first)}",
                "error": pair.error,
                "queries": str(pair.pairs),
                "mean difference": _with_interval(pair.mean, pair.mean_interval),
                "median difference": _with_interval(pair.median, pair.median_interval),
                "won, tied, lost": f"{pair.won}, {pair.tied}, {pair.lost}",
                "sign test": _p(pair.sign_p),
                "permutation test": _p(pair.permutation_p),
            }
            for pair in pairs
        ]
    )


def meanings(comparison: RunComparison, pairs: Sequence[PairedErrors]) -> list[str]:
    """What the figures of the tables are, in sentences."""
    found = set(comparison.statistics["interval"])
    words = []
    if OVER_SEEDS in found:
        words.append(
            "± and (a to b): the 95 % interval of the mean by Student's t over the seeds of a configuration; sd: their"
            " standard deviation"
        )
    if OF_RUN in found:
        words.append("(a to b) of a configuration with one seed: the run's own 95 % interval, over its queries")
    if pairs:
        words += _paired_meanings(pairs)
    return words


def _paired_meanings(pairs: Sequence[PairedErrors]) -> list[str]:
    seeds, missing = max(pair.seeds for pair in pairs), max(pair.missing for pair in pairs)
    how = (
        "query by query: where B - A is below 0, B has the smaller errors, and has won; intervals (95 %): of the mean by Student's t (scipy.stats.ttest_rel), of the median by"
        f" {RESAMPLES} bootstrap samples (percentiles); the sign test is of won and lost, the permutation test of the mean;"
        " each p is of one test alone, not corrected for their number"
    )
    words = [how]
    if seeds > 1:
        words.append(f"query by query: the queries of {seeds} seeds are pooled")
    if missing:
        words.append(
            f"query by query: up to {missing} queries left out, for which one of the two has no error, or was not asked"
        )
    return words


def full_text(row: Any, seeds: int) -> str:
    """A mean with its interval and standard deviation, and of how many seeds it is if not of all."""
    if math.isnan(row.mean) or row.std == 0:
        return _figure(row.mean) + _of(row, seeds)
    text = _with_interval(row.mean, (row.low, row.high)) if row.interval else _figure(row.mean)
    if row.interval == OVER_SEEDS:
        text += f", sd {row.std:.2g}"
    return text + _of(row, seeds)


def short_text(row: Any, seeds: int) -> str:
    """A mean with half its interval."""
    if math.isnan(row.mean) or row.std == 0:
        return _figure(row.mean) + _of(row, seeds)
    if row.interval == OVER_SEEDS:
        return f"{_figure(row.mean)} ± {(row.high - row.low) / 2:.2g}{_of(row, seeds)}"
    if row.interval == OF_RUN:
        return _with_interval(row.mean, (row.low, row.high))
    return _figure(row.mean) + _of(row, seeds)


def write_csv(comparison: RunComparison, file: Path) -> None:
    """A row a configuration and metric, with all digits; OSError if it cannot be written."""
    table = comparison.statistics.reset_index().sort_values("group", kind="stable")
    first, last = ["group"], ["seeds", "metric", "unit", "n", "mean", "std", "low", "high", "interval"]
    taken = {name: f"setting {name}" for name in [*first, *last]}
    groups = comparison.groups.rename(columns=taken)
    table = table.merge(groups.assign(seeds=comparison.seeds()), left_on="group", right_index=True)
    write_text(file, table[[*first, *groups.columns, *last]].to_csv(index=False))


def write_latex(table: DataFrame, file: Path) -> None:
    """A tabular of the package booktabs; OSError if it cannot be written."""
    write_text(file, _visible(table).to_latex(index=False, escape=True))


def write_markdown(table: DataFrame, file: Path) -> None:
    """A table with bars; OSError if it cannot be written."""
    table = _visible(table)
    table.columns = [MARKDOWN.sub(r"\\\1", column) for column in table.columns]
    table = table.map(lambda cell: MARKDOWN.sub(r"\\\1", cell))
    out = io.StringIO()
    table.to_markdown(out, index=False, tablefmt="pipe", disable_numparse=True)
    write_text(file, out.getvalue() + "\n")


def _visible(table: DataFrame) -> DataFrame:
    """Texts of strangers, in which nothing breaks a line."""
    return table.rename(columns=visible).map(visible)


def _unit(comparison: RunComparison, metric: str) -> str:
    return str(comparison.statistics.xs(metric, level="metric")["unit"].iloc[0])


def _with_interval(value: float, interval: tuple[float, float]) -> str:
    if math.isnan(interval[0]):
        return _figure(value)
    return f"{_figure(value)} ({interval[0]:.4g} to {interval[1]:.4g})"


def _of(row: Any, seeds: int) -> str:
    return f" (n = {row.n})" if 0 < row.n != seeds else ""


def _figure(value: float) -> str:
    return NOTHING if math.isnan(value) else f"{value:.4g}"


def _p(value: float) -> str:
    return NOTHING if math.isnan(value) else f"p = {value:.2g}"


def _few(names: Sequence[str]) -> str:
    if len(names) > FEW_NAMES:
        return f"{names[0]} ... {names[-1]} ({len(names)})"
    return ", ".join(names)
