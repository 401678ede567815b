"""The conformance check of studies."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from omnilab import api
from omnilab.runner.boundaries import check_report
from omnilab.runner.recorder import Recorder
from omnilab.runner.sweeps.objective import is_declared
from omnilab.testing.common import check_common, expect


def check_study(study: Any, parts: api.Parts) -> None:
    """Names parts there are; its report can be kept; the same seed gives the same metrics, bit for bit."""
    check_common("study", study)
    known = {f.name for f in fields(api.Parts)}
    expect(set(study.needs) <= known, f"needs {sorted(set(study.needs) - known)}, there is {sorted(known)}")
    first, second = (study.run(parts, Recorder(), np.random.default_rng(7)) for _ in range(2))
    check_report(first, type(study).__name__)
    expect(len(first.metrics) > 0, "there are no metrics")
    if declared := getattr(study, "metric_names", ()):
        unknown = [metric.name for metric in first.metrics if not is_declared(metric.name, declared)]
        expect(not unknown, f"it measures {', '.join(unknown)}, which `metric_names` does not declare")
    expect(list(first.metrics) == list(second.metrics), "the same seed gives other metrics the second time")
