"""A map that keeps the last appearance of each place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import setting
from omnilab_studies.localization.lifelong_map.appearances import Appearances, DayEstimates, joined, surest


@dataclass
class Update:
    """Of each place that was recognised surely, the day's surest query replaces the signature.

    The place's reference follows what is there now, as the views of Dayoub and Duckett (2008) do, without their two
    stages of memory: what was there before is forgotten at once.
    """

    sure_ratio: float = setting(0.8, above=0, at_most=1)  # largest ratio of an estimate that is believed; 1: all are

    def adapt(self, known: Appearances, estimates: DayEstimates, day: int) -> Appearances:
        """Replace the appearances of the places that were recognised surely."""
        chosen = surest(estimates, self.sure_ratio)
        left = np.flatnonzero(~np.isin(known.place, estimates.place[chosen]))
        return joined(known.at(left), estimates.appearances(chosen, day))
