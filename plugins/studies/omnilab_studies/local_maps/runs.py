"""Local maps of one step after the other, and what came of them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from omnilab.api import Embedder, Embedding, Floats, Ints, Recorder
from omnilab.errors import DataError
from omnilab_studies.common.methods import Method, prepared
from omnilab_studies.local_maps.candidates import ShortLists
from omnilab_studies.local_maps.embedders import STATES, arranged, warm_up
from omnilab_studies.local_maps.results import Case, Times, Trial, trial_of


class Attempts:
    """Maps made of short lists, by every method and localizer, and what came of them."""

    def __init__(self, makers: Mapping[str, Embedder], seeds: Ints, record: Recorder) -> None:
        self.makers, self._seeds, self._record = makers, seeds, record
        self.trials: list[Trial] = []
        self.misfits: dict[str, str] = {}  # methods that cannot compare the images, and why
        warm_up(makers.values())

    def make(self, step_m: float, lists: ShortLists, methods: Sequence[Method], neighbours: Sequence[int]) -> None:
        """All maps of one step."""
        able = [method for method in methods if self._goes_together(method, lists)]
        todo = [(count, method) for count in neighbours for method in able]
        for count, method in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            start = time.perf_counter()
            with self._record.timed("compare", len(lists.near)):
                pairs = lists.pairs(method, count)
            pairs_ms = 1e3 * (time.perf_counter() - start) / len(pairs)
            for name, maker in self.makers.items():
                with self._record.timed(f"arrange: {name}", len(pairs)):
                    made = arranged(maker, pairs, self._seeds)
                times = Times(lists.search_ms, pairs_ms, _arrange_ms(maker, pairs, self._seeds[0]))
                case = Case(step_m, count, method.name, name)
                size = len(lists.places.position_m)
                self.trials.append(trial_of(case, made, lists.places_m(count), lists.truth_m, size, times))
        if not self.trials:
            why = next(iter(self.misfits.values()))
            raise DataError(f"none of the distances can compare any of the signatures ({why}); choose others")

    def _goes_together(self, method: Method, lists: ShortLists) -> bool:
        try:
            prepared(method, lists.places.signatures[method.descriptor_name], rotated=True)
        except DataError as reason:
            self.misfits[method.name] = f"{method.name}: {reason}"
        return method.name not in self.misfits

    def again(self, case: Case, pairs: Floats) -> Embedding:
        """The first maps of a trial once more, with the states on the way."""
        return self.makers[case.localizer].embed(pairs, np.random.default_rng(self._seeds[0]), STATES)


def _arrange_ms(maker: Embedder, pairs: Floats, seed: int) -> float:
    """Milliseconds a map, from one start."""
    start = time.perf_counter()
    maker.embed(pairs, np.random.default_rng(seed))
    return 1e3 * (time.perf_counter() - start) / len(pairs)
