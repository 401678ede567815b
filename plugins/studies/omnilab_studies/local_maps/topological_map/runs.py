"""Runs of topological maps: every method, kind of lengths and embedder on one grid after the other."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from omnilab.api import Embedder, Floats, Recorder
from omnilab.errors import ConfigError, DataError
from omnilab_studies.common.methods import Method, prepared
from omnilab_studies.local_maps.candidates import DescribedImages
from omnilab_studies.local_maps.embedders import STATES, pairwise_distances
from omnilab_studies.local_maps.topological_map.lengths import Lengths, slope_of
from omnilab_studies.local_maps.topological_map.results import COMBINED, TopologicalMapCase, TopologicalMapResult


class TopologicalMapRuns:
    """Maps of whole grids by every method, kind of lengths and embedder, and their results."""

    def __init__(
        self,
        embedders: Mapping[str, Embedder],
        lengths: Sequence[Lengths],
        combined: Sequence[str],
        slope_m: float | None,
        random_headings: bool,
        seed: int,
        record: Recorder,
    ) -> None:
        if slope_m and not any(_has_slope(embedder) for embedder in embedders.values()):
            raise ConfigError(
                f"study.slope_m={slope_m:g} measures the slope of localizers that have one, and none has; leave it out"
            )
        self._embedders, self._lengths, self._combined = embedders, lengths, combined
        self._slope_m, self._random_headings, self._seed, self._record = slope_m, random_headings, seed, record
        self._slopes: dict[str, float] = {}  # c of each method, measured on the first grid
        self.results: list[TopologicalMapResult] = []
        self.unsuited: list[str] = []  # methods that cannot compare the images, each with its reason

    def run(self, step_m: float, room: str, images: DescribedImages, methods: Sequence[Method]) -> None:
        """All maps of one grid."""
        distances: dict[str, Floats] = {}
        todo = list(self._todo(methods))
        for names, lengths in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            title = names[0] if len(names) == 1 else COMBINED
            case = TopologicalMapCase(step_m, title, lengths, "", room)
            try:
                for method in methods:
                    if method.name in names and method.name not in distances:
                        distances[method.name] = self._distances(method, images)
                length = lengths.of([distances[name] for name in names])
            except DataError as reason:
                self.unsuited.append(f"{title}, {step_m:g} m, {lengths.title}: {reason}")
                continue
            for name, embedder in self._embedders.items():
                fitting = self._with_slope(embedder, case)
                self._embed(case._replace(localizer=name), fitting, length, images)

    def _todo(self, methods: Sequence[Method]) -> Iterator[tuple[Sequence[str], Lengths]]:
        """Names of methods, and how their distances become lengths."""
        for method in methods:
            for lengths in self._lengths:
                yield [method.name], lengths
        for lengths in self._lengths:
            if self._combined and lengths.conformal:
                yield self._combined, lengths

    def _embed(self, case: TopologicalMapCase, embedder: Embedder, length: Floats, images: DescribedImages) -> None:
        start = time.perf_counter()
        with self._record.timed(f"embed: {case.localizer}"):
            embedding = embedder.embed(length[None], np.random.default_rng(self._seed), STATES)
        embed_s = time.perf_counter() - start
        self.results.append(TopologicalMapResult(case, images.position_m, length, embedding, embed_s))

    def _with_slope(self, embedder: Embedder, case: TopologicalMapCase) -> Embedder:
        """The embedder with the slope that was measured for the method, where lengths are image distances."""
        if not self._slope_m or not case.lengths.are_distances or not _has_slope(embedder):
            return embedder
        return replace(embedder, slope=self._slopes[case.method])  # type: ignore[type-var]  # a dataclass, as _has_slope asks

    def _distances(self, method: Method, images: DescribedImages) -> Floats:
        """The distances (n, n) among all images."""
        signatures = images.signatures[method.descriptor_name]
        prepared(method, signatures, self._random_headings)  # raises where the distance cannot compare the signatures
        with self._record.timed("compare", len(images.position_m) ** 2):
            pairs = pairwise_distances(method, signatures)
        if self._slope_m and method.name not in self._slopes:
            self._slopes[method.name] = slope_of(pairs, images.position_m, self._slope_m)
        return pairs


def _has_slope(embedder: Any) -> bool:
    return "slope" in {f.name for f in fields(embedder)}
