"""Runs of local maps: every method and embedder on the candidates of one grid after the other."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from omnilab.api import Embedder, Embedding, Floats, Ints, Recorder
from omnilab.errors import DataError
from omnilab_studies.common.methods import Method, prepared
from omnilab_studies.local_maps.candidates import Candidates
from omnilab_studies.local_maps.embedders import STATES, embed_from_seeds, warm_up
from omnilab_studies.local_maps.results import LocalMapCase, LocalMapResult, LocalMapTimes, score_local_maps


class LocalMapRuns:
    """Local maps by every method and embedder, from every seed, and their results."""

    def __init__(self, embedders: Mapping[str, Embedder], seeds: Ints, record: Recorder) -> None:
        self.embedders, self._seeds, self._record = embedders, seeds, record
        self.results: list[LocalMapResult] = []
        self.unsuited: dict[str, str] = {}  # methods that cannot compare the images, each with its reason
        warm_up(embedders.values())

    def run(self, step_m: float, candidates: Candidates, methods: Sequence[Method], neighbours: Sequence[int]) -> None:
        """All maps of one grid; DataError if no method can compare its images."""
        suited = [method for method in methods if self._is_suited(method, candidates)]
        todo = [(count, method) for count in neighbours for method in suited]
        for count, method in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            start = time.perf_counter()
            with self._record.timed("compare", len(candidates.nearest)):
                pairs = candidates.pairwise_distances(method, count)
            pairs_ms = 1e3 * (time.perf_counter() - start) / len(pairs)
            for name, embedder in self.embedders.items():
                with self._record.timed(f"embed: {name}", len(pairs)):
                    embeddings = embed_from_seeds(embedder, pairs, self._seeds)
                times = LocalMapTimes(candidates.search_ms, pairs_ms, _embed_ms(embedder, pairs, self._seeds[0]))
                case = LocalMapCase(step_m, count, method.name, name)
                size = len(candidates.places.position_m)
                self.results.append(
                    score_local_maps(case, embeddings, candidates.places_m(count), candidates.truth_m, size, times)
                )
        if not self.results:
            why = next(iter(self.unsuited.values()))
            raise DataError(f"none of the distances can compare any of the signatures ({why}); choose others")

    def _is_suited(self, method: Method, candidates: Candidates) -> bool:
        try:
            prepared(method, candidates.places.signatures[method.descriptor_name], rotated=True)
        except DataError as reason:
            self.unsuited[method.name] = f"{method.name}: {reason}"
        return method.name not in self.unsuited

    def embed_with_states(self, case: LocalMapCase, pairs: Floats) -> Embedding:
        """The embedding of a case from the first seed once more, with its intermediate states."""
        return self.embedders[case.localizer].embed(pairs, np.random.default_rng(self._seeds[0]), STATES)


def _embed_ms(embedder: Embedder, pairs: Floats, seed: int) -> float:
    """Milliseconds a map, from one seed."""
    start = time.perf_counter()
    embedder.embed(pairs, np.random.default_rng(seed))
    return 1e3 * (time.perf_counter() - start) / len(pairs)
