"""Local maps by masses, springs and dampers: method 2 of the thesis, as printed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from omnilab.api import Floats, Ints, setting
from omnilab_appearance.localizers.local_maps import LocalMapLocalizer, log, marks_of


class Integrator(Enum):
    """The integration scheme."""

    euler = "euler"
    verlet = "verlet"


@dataclass
class Spring(LocalMapLocalizer):
    """A local map by springs whose rest lengths are the image distances, from random positions (Berenguer, thesis, 2.3, 4.5.2).

    After Payá et al. (2016, eq. 1-6, 14, 15), with three misprints put right: a stretched spring pulls, the damper acts
    along its spring, and eq. 6 takes the velocity from p(t - Δt). Of several starts the one of lowest energy is
    answered. Lengths are in units of the mean distance, so that the scale of a distance does not matter (but with
    `slope`). Systems that diverge are run again with half the time step, with a warning.
    """

    integrator: Integrator = Integrator.verlet  # euler (eq. 4) or verlet (eq. 5-6)
    starts: int = setting(4, at_least=1, at_most=10_000)  # random ones
    damping: float = setting(0.6, above=0, at_most=1e6)  # of every damper, N s per unit of length
    step_s: float = setting(0.03, above=0, at_most=1000)  # Δt
    tolerance: float = setting(
        1e-3, above=0
    )  # settled where springs change by less, root mean square, in mean distances a second
    iterations: int = setting(10_000, at_least=1)  # at most

    def _embed(
        self, lengths: Floats, weights: Floats, rng: np.random.Generator, steps: int
    ) -> tuple[Floats, Ints, Floats | None]:
        """Integrate every system from every start; the lowest energy wins."""
        sets, n = lengths.shape[:2]
        mean = lengths.sum(axis=(1, 2)) / np.maximum((weights > 0).sum(axis=(1, 2)), 1)
        unit = np.where(mean > 0, mean, 1.0)[:, None, None]
        lengths = lengths / unit
        start = np.tile(rng.uniform(-1, 1, (self.starts, 2, n)), (sets, 1, 1))
        no_marks = np.empty((0, len(start)), np.int64)
        position, energy, iterations, step_s, _ = self._settle(lengths, weights, start, no_marks)
        self._warn(iterations, step_s)
        best = energy.reshape(sets, -1).argmin(axis=1) + np.arange(sets) * self.starts
        taken = np.where(iterations[best] < 0, self.iterations, iterations[best])
        states = None
        if steps:
            states = self._settle(lengths, weights, start[best], marks_of(taken, steps))[4].swapaxes(2, 3) * unit
        return position[best].swapaxes(1, 2) * unit, taken, states

    def _settle(self, lengths: Floats, weights: Floats, start: Floats, marks: Ints) -> Any:
        from omnilab_appearance.localizers import map_kernels

        damping = np.where(weights > 0, self.damping, 0.0)
        verlet = self.integrator is Integrator.verlet
        return map_kernels.springs(
            lengths, weights, damping, start, verlet, self.step_s, self.tolerance, self.iterations, marks
        )

    def _warn(self, iterations: Ints, step_s: Floats) -> None:
        """Warn of systems that diverged, and of those that did not come to rest."""
        if (smaller := step_s < self.step_s).any():
            log.warning("springs flew apart with step_s=%g in %d of %d systems, which were run again with steps down to"
                        " %.2g s", self.step_s, smaller.sum(), len(step_s), step_s.min())  # fmt: skip
        if (restless := iterations < 0).any():
            log.warning("%d of %d systems of springs were still moving after %d iterations; raise iterations, damping or"
                        " tolerance", restless.sum(), len(step_s), self.iterations)  # fmt: skip
