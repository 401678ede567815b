"""Candidates of a local map: the places most alike to each query, described by several methods."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Frames, Ints, Recorder, Signatures
from omnilab.errors import DataError
from omnilab.limits import check_work
from omnilab_studies.common.describing import check_signatures
from omnilab_studies.common.methods import Method, check_comparisons, describe_all, joined_signatures, prepared
from omnilab_studies.common.scores import known_poses, warn_of_equal_signatures
from omnilab_studies.local_maps.embedders import pairwise_distances


@dataclass(frozen=True)
class DescribedImages:
    """N images, described by the descriptor of every method."""

    signatures: Mapping[str, Signatures]  # by the descriptor's name
    position_m: Floats  # (N, 3)
    omitted: Sequence[str]  # frames that could not be delivered, each with its reason


def describe_images(
    methods: Sequence[Method], batches: Iterable[Frames], total: int, what: str, record: Recorder
) -> DescribedImages:
    """Describe every one of `total` images once by each descriptor of the methods.

    DataError if there is no image, or no pose; ConfigError if their signatures do not fit into memory.
    """
    parts: dict[str, list[Signatures]] = {method.descriptor_name: [] for method in methods}
    position_m: list[Floats] = []
    keys: list[str] = []
    omitted: list[str] = []
    for frames in batches:
        for name, signatures in describe_all(methods, frames, record).items():
            if not parts[name]:
                check_signatures(signatures, total, what)
            parts[name].append(signatures)
        position_m.append(known_poses(frames.T_world_camera, what)[:, :3, 3])
        keys += frames.keys
        omitted += frames.omitted
    if not position_m:
        raise DataError(f"the sensor delivered no {what} for the study's layout; look at what it left out")
    joined = {name: joined_signatures(found) for name, found in parts.items()}
    warn_of_equal_signatures(joined, keys, what, record)
    return DescribedImages(joined, np.concatenate(position_m), omitted)


@dataclass(frozen=True)
class Candidates:
    """The places of one grid, and which of them are most alike to each of Q queries, best first."""

    places: DescribedImages
    queries: DescribedImages
    nearest: Ints  # (Q, K) indices of places
    search_ms: float  # a query

    def pairwise_distances(self, method: Method, count: int, first: int | None = None) -> Floats:
        """Distances (Q, count + 1, count + 1) among `count` candidates and, last, their query; of the `first` queries."""
        check_work(
            f"the distances among the {count} candidates of {len(self.nearest[:first])} queries",
            "give fewer study.neighbours or a smaller study.query_count",
            memory=8 * (count + 1) ** 2 * len(self.nearest[:first]),
        )
        places = self.places.signatures[method.descriptor_name]
        queries = self.queries.signatures[method.descriptor_name]
        return np.stack(
            [
                pairwise_distances(method, joined_signatures([places[nearest[:count]], queries[q : q + 1]]))
                for q, nearest in enumerate(self.nearest[:first])
            ]
        )

    def places_m(self, count: int) -> Floats:
        """True positions (Q, count, 2) of the `count` best candidates of each query."""
        return self.places.position_m[self.nearest[:, :count], :2]

    @property
    def truth_m(self) -> Floats:
        """True positions (Q, 2) of the queries."""
        return self.queries.position_m[:, :2]


def find_candidates(
    retrieval: Method, places: DescribedImages, queries: DescribedImages, count: int, record: Recorder
) -> Candidates:
    """The `count` places that are most alike to each query by the retrieval method."""
    check_comparisons(len(queries.position_m), len(places.position_m))
    index = prepared(retrieval, places.signatures[retrieval.descriptor_name], rotated=True)
    start = time.perf_counter()
    with record.timed("search", len(queries.position_m)):
        match = retrieval.distance.match(queries.signatures[retrieval.descriptor_name], index)
        nearest = match.distance.argsort(axis=1, kind="stable")[:, :count]
    return Candidates(places, queries, nearest, 1e3 * (time.perf_counter() - start) / len(nearest))


def keep_first(batches: Iterable[Frames], kept: list[tuple[Frames, int]], count: int) -> Iterator[Frames]:
    """Pass batches on, and append the first `count` frames to `kept`, each as its batch and index."""
    for frames in batches:
        kept += [(frames, i) for i in range(min(len(frames), count - len(kept)))]
        yield frames
