"""A comparison as one JSON document: all that the tables say, for other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from omnilab.runner.compare.comparison import CONFIDENCE, RunComparison
from omnilab.runner.compare.error_curves import SHARES, ErrorCurve, error_curves
from omnilab.runner.compare.paired import PairedErrors, named, paired_errors
from omnilab.runner.compare.tables import full_text, meanings
from omnilab.runner.terminal import brief

FORMAT, VERSION = "omnilab-comparison", 1


def comparison_document(comparison: RunComparison) -> dict[str, Any]:
    """Everything that is known of a comparison, as JSON can hold it: what has no value is null."""
    pairs, notes = paired_errors(comparison)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "confidence": CONFIDENCE,
        "settings": comparison.settings,
        "metrics": [{"name": name, "unit": _unit(comparison, name)} for name in comparison.metrics],
        "configurations": _configurations(comparison),
        "runs": _runs(comparison),
        "paired": [_pair(pair) for pair in pairs],
        "error_curves": {"shares": SHARES, "curves": [_curve(curve) for curve in error_curves(comparison)]},
        "left_out": [asdict(run) for run in comparison.left_out],
        "notes": [*comparison.notes, *notes],
        "meanings": meanings(comparison, pairs),
    }
    whole: dict[str, Any] = without_nan(document)
    return whole


def without_nan(value: Any) -> Any:
    """The same as JSON can hold it: None for what is no finite number."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): without_nan(member) for key, member in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [without_nan(member) for member in value]
    return value


def _unit(comparison: RunComparison, metric: str) -> str:
    return str(comparison.statistics.xs(metric, level="metric")["unit"].iloc[0])


def _configurations(comparison: RunComparison) -> list[dict[str, Any]]:
    """Each with its settings, and the statistics of its metrics over seeds."""
    metrics: dict[int, dict[str, Any]] = {group: {} for group in comparison.groups.index}
    seeds = comparison.seeds()
    for row in comparison.statistics.reset_index().itertuples():
        statistics = {name: getattr(row, name) for name in ("mean", "std", "low", "high", "interval")}
        metrics[row.group][row.metric] = (
            {"n": int(row.n)} | statistics | {"text": brief(full_text(row, seeds[row.group]))}
        )
    return [
        {"name": named(group), "settings": dict(settings), "seeds": count, "metrics": metrics[group]}
        for (group, settings), count in zip(comparison.groups.iterrows(), seeds, strict=True)
    ]


def _runs(comparison: RunComparison) -> list[dict[str, Any]]:
    """Each with its own metrics, and the name of its configuration."""
    values = comparison.values.to_dict("index")
    return [
        {
            "name": row.run,
            "folder": str(row.folder),
            "seed": row.seed,
            "configuration": named(row.group),
            "metrics": values[row.Index],
        }
        for row in comparison.runs.itertuples()
    ]


def _pair(pair: PairedErrors) -> dict[str, Any]:
    return asdict(pair) | {"first": named(pair.first), "second": named(pair.second)}


def _curve(curve: ErrorCurve) -> dict[str, Any]:
    content = {name: value for name, value in asdict(curve).items() if name != "group"}
    return {"configuration": named(curve.group)} | content
