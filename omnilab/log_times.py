"""When the records of a run lie on its own clock: all of one step at one time, curves that come later included."""

from __future__ import annotations

import math
import time

import numpy as np

from omnilab.api import Ints

MOST_STEPS = 1 << 17  # whose times are remembered, some 20 MB; of older ones a later record lies where it is logged


class LogTimes:
    """The run's clock, ns since 1970, which never steps back, and the times of its steps.

    A step lies where its first record was logged, and so do all its later records: the error of an image that is known
    when the run ends lies at the image. Sinks ask it once for each record, also for those that they leave out.
    """

    def __init__(self) -> None:
        self._now = time.time_ns()
        self._steps: dict[int, int] = {}
        self._last_step = -math.inf

    def now(self) -> int:
        """The time of a record without a step."""
        self._now = max(self._now, time.time_ns())
        return self._now

    def of_step(self, step: int) -> int:
        """The time of a step's record."""
        now = self.now()
        if step not in self._steps:
            self._remember(step, now)
        return self._steps[step]

    def of_steps(self, steps: Ints) -> Ints:
        """The times (n,) of a curve's rows, int64.

        Steps of which nothing was logged lie between their neighbours. Those after all others are what the run has
        worked on since the last record: they share that while evenly.
        """
        before, now, wanted = self._now, self.now(), np.asarray(steps).tolist()
        unknown = sorted({step for step in wanted if step not in self._steps})
        between = [step for step in unknown if step <= self._last_step]
        later = unknown[len(between) :]
        found = dict(zip(between, self._between(between), strict=True)) if between else {}
        found |= {step: before + (now - before) * i // len(later) for i, step in enumerate(later, start=1)}
        times = [found[step] if step in found else self._steps[step] for step in wanted]
        for step, at in found.items():
            self._remember(step, at)
        return np.array(times, np.int64)

    def _between(self, steps: list[int]) -> list[int]:
        """The times of steps among those that are known, of earlier ones that of the first."""
        known = np.array(sorted(self._steps.items()), np.int64)
        first = known[0, 1]  # a float cannot tell one nanosecond since 1970 from the next
        after = np.interp(steps, known[:, 0], known[:, 1] - first).astype(np.int64)
        return [int(time_ns) for time_ns in first + after]

    def _remember(self, step: int, at: int) -> None:
        self._steps[step] = at
        self._last_step = max(self._last_step, step)
        if len(self._steps) > MOST_STEPS:
            del self._steps[next(iter(self._steps))]
