"""Evenly spaced samples, and the statistics of a sample as metrics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from omnilab.api import Floats, Ints, Metric


def evenly(count: int, most: int) -> Ints:
    """At most `most` evenly spaced indices into `count` items, the first and the last included."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def of_known(statistic: Callable[[Floats], Any], values: Floats) -> float:
    """A statistic of those values (N,) that are finite; NaN if none is."""
    known = values[np.isfinite(values)]
    return float(statistic(known)) if len(known) else float("nan")


def statistics(name: str, values: Floats, unit: str) -> list[Metric]:
    """Median, mean and 95 % quantile of values (N,) as the metrics NAME_median, NAME_mean and NAME_p95."""
    return [
        Metric(f"{name}_median", float(np.median(values)), unit),
        Metric(f"{name}_mean", float(np.mean(values)), unit),
        Metric(f"{name}_p95", float(np.quantile(values, 0.95)), unit),
    ]
