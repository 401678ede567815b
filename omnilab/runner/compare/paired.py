"""Two configurations, query by query, where they were asked the same queries."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab.runner.compare.comparison import CONFIDENCE, RunComparison
from omnilab.runner.run_folder import load_run

if TYPE_CHECKING:
    from pandas import DataFrame

MOST = 5  # configurations that are compared with the first
RESAMPLES, SEED = 9999, 0
BATCH_NUMBERS = 2**22  # of resamples in memory at once: 32 MiB
QUERY, POSE = ["query", "key"], re.compile(r"truth_\w+")
ERROR = re.compile(r"(\w+_)?error_(\w+)")  # a column of errors, and its unit


@dataclass(frozen=True)
class PairedErrors:
    """Errors of one kind at the same queries: the differences are those of `second` minus those of `first`."""

    first: int  # groups of a `RunComparison`
    second: int
    error: str  # the column of queries.csv
    unit: str
    seeds: int  # over whose queries they are pooled
    pairs: int
    missing: int  # queries that one of the two has no error for
    mean: float
    mean_interval: tuple[float, float]  # 95 %, scipy.stats.ttest_rel
    median: float
    median_interval: tuple[float, float]  # 95 %, scipy.stats.bootstrap, percentiles
    won: int  # queries at which the second has the smaller error
    tied: int
    lost: int
    sign_p: float  # scipy.stats.binomtest on won and lost
    permutation_p: float  # scipy.stats.permutation_test of the mean difference, signs exchanged


def paired_errors(comparison: RunComparison) -> tuple[list[PairedErrors], list[str]]:
    """Every configuration beside the first, at the queries that runs of one seed both were asked; and what was not paired.

    Queries are the same if number, key and true pose are.
    """
    others = list(comparison.groups.index[1:])
    if len(others) > MOST:
        return [], [f"query by query: of {len(others) + 1} configurations none; name the runs of up to {MOST + 1}"]
    found, notes = list[PairedErrors](), list[str]()
    for second in others:
        try:
            found += _paired(comparison, comparison.groups.index[0], second)
        except DataError as error:
            notes.append(f"query by query: {error}")
    return found, list(dict.fromkeys(notes))


def _paired(comparison: RunComparison, first: int, second: int) -> list[PairedErrors]:
    """All kinds of errors of two groups; DataError if no run of one was asked what a run of the other was."""
    folders = comparison.runs.set_index("seed").groupby("group")["folder"]
    of_first, of_second = (dict(folders.get_group(group)) for group in (first, second))
    seeds = [seed for seed in of_first if seed in of_second]
    if not seeds:
        raise DataError(f"runs of one seed are paired, and {named(first)} and {named(second)} have no seed in common")
    tables = [_same_queries(of_first[seed], of_second[seed]) for seed in seeds]
    errors = [column.removesuffix("_first") for column in tables[0] if column.endswith("_first")]
    return [_compared_errors(tables, error, first, second) for error in errors]


def named(group: int) -> str:
    """What a group is called in tables: A, B, ..., Z, AA, ..."""
    return (named(group // 26 - 1) if group >= 26 else "") + chr(ord("A") + group % 26)


def unit_of(error: str) -> str:
    """The unit of a column of errors, which its name ends with."""
    return re.sub(ERROR, r"\2", error)


def _same_queries(first: Path, second: Path) -> DataFrame:
    """The errors of two runs side by side; DataError if they were not asked the same queries."""
    tables = [_queries(first), _queries(second)]
    keys = [c for c in tables[0] if c in QUERY or POSE.fullmatch(c)]
    both = [c for c in tables[0] if ERROR.fullmatch(c) and c in tables[1]]
    if not set(keys) <= set(tables[1]) or not both:
        raise DataError(f"{first} and {second} have no errors of one kind in their queries.csv")
    merged = tables[0][keys + both].merge(tables[1][keys + both], on=keys, suffixes=("_first", "_second"))
    if len(merged) < 2:
        raise DataError(f"{first} and {second} were not asked the same queries (number, key and pose are compared)")
    merged.attrs["alone"] = sum(len(table) for table in tables) - 2 * len(merged)
    return merged


def _queries(folder: Path) -> DataFrame:
    """The table of queries of a run; DataError if it has none, or says not which query is which."""
    import pandas as pd

    table = pd.DataFrame(load_run(folder).table("queries"), dtype=object)
    if not set(QUERY) <= set(table) or not any(POSE.fullmatch(column) for column in table):
        raise DataError(f"{folder} has no queries.csv with keys and poses (columns query, key, truth_...)")
    if table.duplicated(QUERY).any():
        raise DataError(f"{folder / 'queries.csv'} names a query twice")
    for column in table:
        if ERROR.fullmatch(column) or POSE.fullmatch(column):
            table[column] = _numbers(folder, column, table[column])
    return table


def _numbers(folder: Path, column: str, texts: Any) -> Floats:
    """A column of numbers, NaN where it is empty or infinite; DataError if it holds anything else."""
    try:
        numbers = np.array([float(text or "nan") for text in texts])
    except ValueError as error:
        raise DataError(f"{folder / 'queries.csv'} holds {column}s that are no numbers") from error
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _compared_errors(tables: Sequence[DataFrame], error: str, first: int, second: int) -> PairedErrors:
    """One kind of errors, over the queries of all seeds."""
    sides = [
        np.concatenate([table[f"{error}_{side}"].to_numpy(float) for table in tables]) for side in ("first", "second")
    ]
    known = np.isfinite(sides[0]) & np.isfinite(sides[1])
    a, b = sides[0][known], sides[1][known]
    alone = sum(table.attrs["alone"] for table in tables)
    won, lost = int((b < a).sum()), int((b > a).sum())
    return PairedErrors(
        first, second, error, unit_of(error), len(tables), len(a), int((~known).sum()) + alone,
        **_intervals(a, b), won=won, tied=len(a) - won - lost, lost=lost, **_tests(a, b, won, lost),
    )  # fmt: skip


def _intervals(a: Floats, b: Floats) -> dict[str, Any]:
    """Mean and median of b - a, with their intervals: NaN below two pairs."""
    from scipy import stats

    nothing, difference = (np.nan, np.nan), b - a
    if len(a) < 2:
        middle = float(difference[0]) if len(a) else np.nan
        return {"mean": middle, "mean_interval": nothing, "median": middle, "median_interval": nothing}
    mean, median = float(difference.mean()), float(np.median(difference))
    if np.ptp(difference) == 0:
        return {"mean": mean, "mean_interval": (mean, mean), "median": median, "median_interval": (median, median)}
    found = stats.bootstrap(
        (difference,), np.median, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile",
        batch=_batch(a), rng=np.random.default_rng(SEED),
    ).confidence_interval  # fmt: skip
    by_t = stats.ttest_rel(b, a).confidence_interval(CONFIDENCE)
    return {
        "mean": mean, "mean_interval": (float(by_t.low), float(by_t.high)),
        "median": median, "median_interval": (float(found.low), float(found.high)),
    }  # fmt: skip


def _tests(a: Floats, b: Floats, won: int, lost: int) -> dict[str, Any]:
    """Whether the differences could be chance: NaN where there are none, or one pair."""
    from scipy import stats

    if won + lost == 0 or len(a) < 2:
        return {"sign_p": np.nan, "permutation_p": np.nan}

    def mean_difference(x: Floats, y: Floats, axis: int) -> Floats:
        return np.asarray(np.mean(x - y, axis=axis))

    permuted = stats.permutation_test(
        (b, a), mean_difference, permutation_type="samples", vectorized=True, n_resamples=RESAMPLES,
        batch=_batch(a), rng=np.random.default_rng(SEED),
    )  # fmt: skip
    return {
        "sign_p": float(stats.binomtest(won, won + lost).pvalue),
        "permutation_p": float(permuted.pvalue),
    }


def _batch(a: Floats) -> int:
    return max(1, BATCH_NUMBERS // len(a))
