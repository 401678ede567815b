"""The conformance check of studies."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from omnilab import api
from omnilab.runner.recorder import Recorder
from omnilab.testing.common import check_common, expect


def check_study(study: Any, parts: api.Parts) -> None:
    """Names parts there are; the same seed gives the same metrics, bit for bit, and every metric has one name."""
    check_common("study", study)
    known = {f.name for f in fields(api.Parts)}
    expect(set(study.needs) <= known, f"needs {sorted(set(study.needs) - known)}, there is {sorted(known)}")
    first, second = (study.run(parts, Recorder(), np.random.default_rng(7)) for _ in range(2))
    names = [metric.name for metric in first.metrics]
    expect(len(names) == len(set(names)) > 0, f"the metrics {names} are none or not unique")
    expect(list(first.metrics) == list(second.metrics), "the same seed gives other metrics the second time")
    for name, table in first.tables.items():
        expect(len({len(column) for column in table.values()}) <= 1, f"the columns of table '{name}' differ in length")
