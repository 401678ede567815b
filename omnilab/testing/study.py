"""The conformance check of studies."""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np

from omnilab import api
from omnilab.runner.boundaries import check_report
from omnilab.runner.recorder import Recorder
from omnilab.runner.sweeps.objective import is_declared
from omnilab.testing.common import expect
from omnilab.testing.parts import study_parts
from omnilab.testing.rules import CannotCheckError, Trial, conform, rule


def check_study(study: Any, parts: api.Parts | None = None) -> None:
    """Names parts there are; its report can be kept; the same seed gives the same metrics, bit for bit.

    Without `parts` it is given those of `study_parts`: a small room, and of each kind the plainest that are installed.
    """
    conform(StudyTrial(study, parts))


class StudyTrial(Trial):
    """A study and its parts."""

    kind = "study"

    def __init__(self, study: Any, parts: api.Parts | None = None) -> None:
        super().__init__(study)
        self._parts = parts

    @cached_property
    def parts(self) -> api.Parts:
        return self._parts or study_parts(self.given.needs)

    @cached_property
    def report(self) -> api.Report:
        return self._run()

    def _run(self) -> api.Report:
        report: api.Report = self.component.run(self.parts, Recorder(), np.random.default_rng(7))
        return report

    @rule("needs parts there are")
    def needs(self) -> None:
        known = {f.name for f in fields(api.Parts)}
        unknown = sorted(set(self.given.needs) - known)
        expect(not unknown, f"needs {', '.join(unknown)}, there is {', '.join(sorted(known))}")

    @rule("reports metrics, tables and figures that can be kept")
    def reports(self) -> None:
        check_report(self.report, type(self.given).__name__)
        expect(len(self.report.metrics) > 0, "there are no metrics; a report has one at least")

    @rule("measures what `metric_names` declares")
    def declared(self) -> None:
        names = getattr(self.given, "metric_names", ())
        if not names:
            raise CannotCheckError("it declares none, so that a misspelt `objective` is found out at the end of a run")
        unknown = [metric.name for metric in self.report.metrics if not is_declared(metric.name, names)]
        expect(not unknown, f"it measures {', '.join(unknown)}, which `metric_names` does not declare")

    @rule("measures the same from the same seed, bit for bit")
    def deterministic(self) -> None:
        one, other = ([_known(metric) for metric in report.metrics] for report in (self.report, self._run()))
        expect(one == other, "the same seed gives other metrics the second time; draw from `rng` alone")


def _known(metric: api.Metric) -> tuple[str, str, str]:
    """A metric as what compares equal to itself, NaN or not."""
    return metric.name, repr(metric.value), metric.unit
