"""Results of the study `joint`: positions and heights of the queries at each height, metrics, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Metric
from omnilab.metrics import bootstrap
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import ScoredEstimates

LEVEL_M = 0.05  # rises below it have no sign that one could miss


class JointResult(NamedTuple):
    """The estimates for Q queries at one height above the map."""

    offset_m: float
    scored: ScoredEstimates
    estimate: Floats  # (Q,) height over the estimated place, in the altimeter's unit; NaN where there is none
    rise_m: Floats  # (Q,) the true one
    unit: str


def scale_of(results: Sequence[JointResult]) -> float:
    """Metres per unit of the altimeter: 1 where its unit is metres, else the least squares over all queries."""
    if results[0].unit == "m":
        return 1.0
    estimate, rise = (
        np.concatenate(parts) for parts in zip(*((one.estimate, one.rise_m) for one in results), strict=True)
    )
    known = np.isfinite(estimate)
    square = float(estimate[known] @ estimate[known])
    return float(estimate[known] @ rise[known]) / square if square > 0 else float("nan")


def row_of(result: JointResult, scale: float, step_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """The row of one height in the table `joint`."""
    nearest = result.scored.verdict == "nearest"
    low, high = bootstrap(lambda chosen: float(nearest[chosen].mean()), len(nearest), rng)
    estimate_m = scale * result.estimate
    away = np.linalg.norm(result.scored.answer_m[:, :2] - result.scored.truth_m[:, :2], axis=1)
    return {
        "offset_m": result.offset_m,
        "queries": len(nearest),
        "nearest_rate": float(nearest.mean()),
        "nearest_low": low,
        "nearest_high": high,
        "within_step_rate": float(((away <= step_m) & result.scored.decided).mean()),
        "position_error_median_m": float(np.median(away)),
        "heading_error_median_deg": of_known(np.median, result.scored.heading_error_deg),
        "estimate_median_m": _nanmedian(estimate_m),
        "height_error_median_m": _nanmedian(np.abs(estimate_m - result.rise_m)),
        "sign_rate": _sign_rate(result),
        "not_estimated": int(np.isnan(estimate_m).sum()),
    }


def _nanmedian(values: Floats) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def _sign_rate(result: JointResult) -> float:
    """Share of right signs; NaN for queries at the map's own height."""
    if abs(result.offset_m) < LEVEL_M:
        return float("nan")
    return float((np.sign(result.estimate) == np.sign(result.rise_m)).mean())


def metrics_of(rows: Sequence[Mapping[str, Any]], results: Sequence[JointResult], scale: float) -> list[Metric]:
    """Over all heights first, then height by height."""
    near, away = ([r for r in rows if (abs(r["offset_m"]) < LEVEL_M) is level] for level in (True, False))
    error = np.concatenate([np.abs(scale * one.estimate - one.rise_m) for one in results])
    metrics = [
        Metric("nearest_rate", float(np.mean([row["nearest_rate"] for row in rows])), "1"),
        Metric("height_error_median", _nanmedian(error), "m", note=UNKNOWN),
    ]
    if away:
        metrics.append(Metric("sign_rate", float(np.mean([row["sign_rate"] for row in away])), "1"))
    if near:
        metrics.append(Metric("nearest_rate_level", float(np.mean([row["nearest_rate"] for row in near])), "1"))
    if results[0].unit != "m":
        metrics.append(Metric("scale", scale, f"m/{results[0].unit}", note="no height was estimated but 0"))
    for row in rows:
        key = f"{row['offset_m']:+g}m"
        rate = row["nearest_rate"]
        metrics.append(Metric(f"nearest_rate_{key}", rate, "1", (row["nearest_low"], row["nearest_high"])))
        metrics.append(Metric(f"height_error_median_{key}", row["height_error_median_m"], "m", note=UNKNOWN))
    return metrics


UNKNOWN = "no height was estimated"


def rises_m(results: Sequence[JointResult], scale: float) -> tuple[Floats, Floats]:
    """True and estimated rises (N,) in metres, of all queries."""
    return np.concatenate([one.rise_m for one in results]), scale * np.concatenate([one.estimate for one in results])


def query_rows(results: Sequence[JointResult], scale: float) -> dict[str, list[Any]]:
    """The table `queries`: one row a query."""
    rise, estimate = rises_m(results, scale)
    verdict = np.concatenate([one.scored.verdict for one in results])
    offset = np.concatenate([np.full(len(one.estimate), one.offset_m) for one in results])
    return {
        "offset_m": offset.tolist(),
        "verdict": verdict.tolist(),
        "rise_m": rise.tolist(),
        "estimate_m": estimate.tolist(),
    }
