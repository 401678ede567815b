"""Runs of topological maps: every method, number of links and embedder on one grid after the other."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from omnilab.api import Embedder, Floats, Recorder
from omnilab.errors import DataError
from omnilab_studies.common.methods import Method, prepared
from omnilab_studies.local_maps.candidates import DescribedImages
from omnilab_studies.local_maps.embedders import STATES, pairwise_distances
from omnilab_studies.local_maps.topological_map.results import TopologicalMapCase, TopologicalMapResult, geodesic


class TopologicalMapRuns:
    """Maps of whole grids by every method, number of links and embedder, and their results."""

    def __init__(
        self,
        embedders: Mapping[str, Embedder],
        links: Sequence[int],
        random_headings: bool,
        seed: int,
        record: Recorder,
    ) -> None:
        self._embedders, self._links, self._random_headings = embedders, links, random_headings
        self._seed, self._record = seed, record
        self.results: list[TopologicalMapResult] = []
        self.unsuited: list[str] = []  # methods that cannot compare the images, each with its reason

    def run(self, step_m: float, images: DescribedImages, methods: Sequence[Method]) -> None:
        """All maps of one grid."""
        todo = [(method, links) for method in methods for links in self._links]
        for method, links in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            try:
                length = self._distances(method, images, links)
            except DataError as reason:
                self.unsuited.append(f"{method.name}, {step_m:g} m, links {links}: {reason}")
                continue
            for name, embedder in self._embedders.items():
                start = time.perf_counter()
                with self._record.timed(f"embed: {name}"):
                    embedding = embedder.embed(length[None], np.random.default_rng(self._seed), STATES)
                embed_s = time.perf_counter() - start
                case = TopologicalMapCase(step_m, method.name, links, name)
                self.results.append(TopologicalMapResult(case, images.position_m, length, embedding, embed_s))

    def _distances(self, method: Method, images: DescribedImages, links: int) -> Floats:
        """The distances (n, n) among all images, geodesic ones where there are links."""
        signatures = images.signatures[method.descriptor_name]
        prepared(method, signatures, self._random_headings)  # raises where the distance cannot compare the signatures
        with self._record.timed("compare", len(images.position_m) ** 2):
            pairs = pairwise_distances(method, signatures)
        return geodesic(pairs, links) if links else pairs
