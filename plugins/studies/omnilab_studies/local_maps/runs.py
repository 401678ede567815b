"""Local maps of one step after the other, and what came of them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from omnilab.api import Arrangement, Floats, Ints, MapMaker, Recorder
from omnilab.errors import DataError
from omnilab_studies.common.methods import Contestant, prepared
from omnilab_studies.local_maps.candidates import ShortLists
from omnilab_studies.local_maps.embedders import STATES, arranged, warm_up
from omnilab_studies.local_maps.results import Case, Times, Trial, trial_of


class Attempts:
    """Maps made of short lists, by every contestant and localizer, and what came of them."""

    def __init__(self, makers: Mapping[str, MapMaker], seeds: Ints, record: Recorder) -> None:
        self.makers, self._seeds, self._record = makers, seeds, record
        self.trials: list[Trial] = []
        self.misfits: dict[str, str] = {}  # contestants that cannot compare the images, and why
        warm_up(makers.values())

    def make(self, step_m: float, lists: ShortLists, rivals: Sequence[Contestant], neighbours: Sequence[int]) -> None:
        """All maps of one step."""
        able = [rival for rival in rivals if self._goes_together(rival, lists)]
        todo = [(count, rival) for count in neighbours for rival in able]
        for count, rival in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            start = time.perf_counter()
            with self._record.timed("compare", len(lists.near)):
                pairs = lists.pairs(rival, count)
            pairs_ms = 1e3 * (time.perf_counter() - start) / len(pairs)
            for name, maker in self.makers.items():
                with self._record.timed(f"arrange: {name}", len(pairs)):
                    made = arranged(maker, pairs, self._seeds)
                times = Times(lists.search_ms, pairs_ms, _arrange_ms(maker, pairs, self._seeds[0]))
                case = Case(step_m, count, rival.name, name)
                size = len(lists.places.position_m)
                self.trials.append(trial_of(case, made, lists.places_m(count), lists.truth_m, size, times))
        if not self.trials:
            why = next(iter(self.misfits.values()))
            raise DataError(f"none of the distances can compare any of the signatures ({why}); choose others")

    def _goes_together(self, rival: Contestant, lists: ShortLists) -> bool:
        try:
            prepared(rival, lists.places.signatures[rival.descriptor_name], turning=True)
        except DataError as reason:
            self.misfits[rival.name] = f"{rival.name}: {reason}"
        return rival.name not in self.misfits

    def again(self, case: Case, pairs: Floats) -> Arrangement:
        """The first maps of a trial once more, with the states on the way."""
        return self.makers[case.localizer].arrange(pairs, np.random.default_rng(self._seeds[0]), STATES)


def _arrange_ms(maker: MapMaker, pairs: Floats, seed: int) -> float:
    """Milliseconds a map, from one start."""
    start = time.perf_counter()
    maker.arrange(pairs, np.random.default_rng(seed))
    return 1e3 * (time.perf_counter() - start) / len(pairs)
