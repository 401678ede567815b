"""A plugin for tests of sweeps: a study whose jobs wait, fail, or end their process."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from omnilab import Metric, Report, hookimpl
from omnilab.errors import DataError


@dataclass
class Work:
    """Draws numbers for a while."""

    value: float = 1.0
    wait_s: float = 0.0
    how: str = "well"  # or fail, die (the process), die_once (the first time that the file `mark` is not there)
    mark: str = "died"
    needs = ()
    metric_names = "answer", "spread"

    def run(self, parts, record, rng):
        if self.how == "fail":
            raise DataError("this job was told to fail; tell it to do well")
        if self.how == "die" or (self.how == "die_once" and not Path(self.mark).exists()):
            Path(self.mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        draws = []
        for _ in record.track([[1]] * 10, "draws", 10):
            time.sleep(self.wait_s / 10)
            draws.append(self.value * rng.random())
        return Report([Metric("answer", sum(draws), "1"), Metric("spread", max(draws) - min(draws), "1")])


@hookimpl
def register_studies(register):
    register("work", Work)
