"""Distributions of errors over queries, a curve a configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.errors import DataError
from omnilab.runner.compare.comparison import RunComparison
from omnilab.runner.compare.paired import ERROR, unit_of
from omnilab.runner.compare.paired import MOST as MOST_OTHERS
from omnilab.runner.run_folder import load_run

MOST = MOST_OTHERS + 1  # configurations whose curves are told apart
SHARES = tuple(range(101))  # percent of the queries


@dataclass(frozen=True)
class ErrorCurve:
    """Errors of one kind of a configuration: at each of `SHARES`, the error that this share of the queries stays within."""

    group: int
    error: str  # the column of queries.csv
    unit: str
    queries: int  # of all its seeds, with those that have no error
    missing: int  # queries without an error, which no share counts
    quantiles: tuple[float, ...]  # by numpy's default, over the queries with an error


def error_curves(comparison: RunComparison) -> list[ErrorCurve]:
    """The curves of up to `MOST` configurations; none of more, or where queries.csv has no errors, or is damaged."""
    if len(comparison.groups) > MOST:
        return []
    return [
        ErrorCurve(int(group), name, unit_of(name), len(values), int(np.isnan(values).sum()), _quantiles(values))
        for group, runs in comparison.runs.groupby("group")
        for name, values in _errors(runs["folder"].tolist()).items()
        if not np.isnan(values).all()
    ]


def _errors(folders: list[object]) -> dict[str, np.ndarray]:
    """All errors of some runs by their kind."""
    found: dict[str, list[str]] = {}
    for folder in folders:
        try:
            rows = load_run(str(folder)).table("queries")
        except DataError:  # what is damaged is said where queries are paired
            return {}
        for name in filter(ERROR.fullmatch, rows[0] if rows else ()):
            found.setdefault(name, []).extend(row[name] for row in rows)
    return {name: _numbers(texts) for name, texts in found.items()}


def _numbers(texts: list[str]) -> np.ndarray:
    """NaN for what is no finite number."""
    return np.array([_number(text) for text in texts])


def _number(text: str) -> float:
    try:
        value = float(text or "nan")
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan


def _quantiles(values: np.ndarray) -> tuple[float, ...]:
    return tuple(np.percentile(values[~np.isnan(values)], SHARES).tolist())
