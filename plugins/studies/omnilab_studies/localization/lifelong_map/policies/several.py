"""A map that keeps several appearances of each place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from omnilab.api import Ints, setting
from omnilab_studies.localization.lifelong_map.appearances import Appearances, DayEstimates, joined, surest


@dataclass
class Several:
    """A place that was recognised surely, but looks new, gains an appearance; the least recently matched is forgotten.

    A map of several views of one place whose number is bounded (Konolige and Bowman, 2009), to which is added only what is
    recognised badly by what is there (Churchill and Newman, 2013). Between `familiar_ratio` and `sure_ratio` an
    estimate is good enough to be believed and bad enough to be learnt from.
    """

    sure_ratio: float = setting(0.8, above=0, at_most=1)  # largest ratio of an estimate that is believed; 1: all are
    familiar_ratio: float = setting(0.4, at_least=0, at_most=1)  # up to it the place is known well enough
    appearances: int = setting(4, at_least=1, at_most=1000)  # the most of a place

    def adapt(self, known: Appearances, estimates: DayEstimates, day: int) -> Appearances:
        """Mark what was matched, forget where there is no room, add what is new."""
        matched = known.matched_day.copy()
        matched[estimates.row[estimates.ratio <= self.sure_ratio]] = day
        known = replace(known, matched_day=matched)
        chosen = surest(estimates, self.sure_ratio)
        new = chosen[estimates.ratio[chosen] > self.familiar_ratio]
        left = np.setdiff1d(np.arange(len(known)), self._forgotten(known, estimates.place[new]))
        return joined(known.at(left), estimates.appearances(new, day))

    def _forgotten(self, known: Appearances, places: Ints) -> list[int]:
        """Of each of these places that has no room, the appearance that was matched least recently; of equals the oldest."""
        own = (np.flatnonzero(known.place == place) for place in places)
        return [int(rows[known.matched_day[rows].argmin()]) for rows in own if len(rows) >= self.appearances]
