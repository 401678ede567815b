"""Rows of days, and the metrics of policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omnilab.api import Bools, Ints, Metric
from omnilab.metrics import bootstrap
from omnilab_studies.common.samples import of_known
from omnilab_studies.localization.lifelong_map.policy_run import DayResult, PolicyRun


def key_of(name: str) -> str:
    """A policy's name as a part of metric names and log paths."""
    return name.replace(" ", "_")


def rows_of(run: PolicyRun, conditions: Sequence[str], rng: np.random.Generator) -> list[dict[str, Any]]:
    """A row for each day of a policy."""
    return [
        {"policy": run.name, "day": day + 1, "condition": condition, **_row(result, rng)}
        for day, (condition, result) in enumerate(zip(conditions, run.days, strict=True))
    ]


def _row(result: DayResult, rng: np.random.Generator) -> dict[str, Any]:
    nearest, low, high = _rate(_nearest(result), rng)
    return {
        "queries": len(result.scored.verdict),
        "nearest_rate": nearest,
        "nearest_low": low,
        "nearest_high": high,
        "nearest_or_second_rate": float((result.scored.verdict != "wrong").mean()),
        "position_error_median_m": float(np.median(result.scored.error_m)),
        "heading_error_median_deg": of_known(np.median, result.scored.heading_error_deg),
        "updates": result.updates,
        "wrong_updates": result.wrong_updates,
        "signatures": result.signatures,
        "wrong_signatures": result.wrong_signatures,
    }


def short(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row for each day, with the nearest rate of each policy: the columns of the summary."""
    days: dict[int, dict[str, Any]] = {}
    for row in rows:
        days.setdefault(row["day"], {"day": row["day"], "condition": row["condition"]})[row["policy"]] = row[
            "nearest_rate"
        ]
    return list(days.values())


def metrics_of(run: PolicyRun, rng: np.random.Generator) -> list[Metric]:
    """The rate over all days and of the last, what was learnt wrongly, and what the map holds at the end."""
    key, last = key_of(run.name), run.days[-1]
    updates, wrong = sum(day.updates for day in run.days), sum(day.wrong_updates for day in run.days)
    mean, *of_mean = _rate(np.concatenate([_nearest(day) for day in run.days]), rng)
    end, *of_end = _rate(_nearest(last), rng)
    return [
        Metric(f"{key}_nearest_rate_mean", mean, "1", (of_mean[0], of_mean[1])),
        Metric(f"{key}_nearest_rate_last", end, "1", (of_end[0], of_end[1])),
        _share(f"{key}_wrong_update_share", wrong, updates),
        _share(f"{key}_wrong_signature_share", last.wrong_signatures, last.signatures),
        Metric(f"{key}_signatures", last.signatures, "1"),
    ]


def _share(name: str, wrong: int, count: int) -> Metric:
    return Metric(name, wrong / count, "1") if count else Metric(name, np.nan, "1", note="the map took nothing over")


def _nearest(result: DayResult) -> Bools:
    return np.asarray(result.scored.verdict == "nearest")


def _rate(right: Bools, rng: np.random.Generator) -> tuple[float, float, float]:
    """The share, and its 95 % interval."""

    def of(chosen: Ints) -> float:
        return float(right[chosen].mean())

    return float(right.mean()), *bootstrap(of, len(right), rng)
