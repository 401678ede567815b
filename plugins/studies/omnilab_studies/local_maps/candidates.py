"""Images described by several methods, and the places most alike to each query."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Frames, Ints, Recorder, Signatures
from omnilab.errors import DataError
from omnilab_studies.common.methods import Method, describe_all, joined_signatures, prepared
from omnilab_studies.common.scores import known_poses
from omnilab_studies.local_maps.embedders import pair_distances


@dataclass(frozen=True)
class Described:
    """N images as every method's descriptor sees them."""

    signatures: Mapping[str, Signatures]  # by the descriptor's name
    position_m: Floats  # (N, 3)
    omitted: Sequence[str]  # what could not be delivered, each with its reason


def described(methods: Sequence[Method], batches: Iterable[Frames], what: str, record: Recorder) -> Described:
    """Every image described once by each method's descriptor."""
    parts: dict[str, list[Signatures]] = {method.descriptor_name: [] for method in methods}
    position_m: list[Floats] = []
    omitted: list[str] = []
    for frames in batches:
        for name, signatures in describe_all(methods, frames, record).items():
            parts[name].append(signatures)
        position_m.append(known_poses(frames.T_world_camera, what)[:, :3, 3])
        omitted += frames.omitted
    if not position_m:
        raise DataError(f"the sensor delivered no {what} for the study's layout; look at what it left out")
    joined = {name: joined_signatures(found) for name, found in parts.items()}
    return Described(joined, np.concatenate(position_m), omitted)


@dataclass(frozen=True)
class ShortLists:
    """The places of one map, and which of them are most alike to each query, best first."""

    places: Described
    queries: Described
    near: Ints  # (Q, most neighbours)
    search_ms: float  # a query

    def pairs(self, method: Method, count: int, some: int | None = None) -> Floats:
        """Distances (Q, count + 1, count + 1) among a query's `count` places and, last, the query; of the first `some`."""
        places = self.places.signatures[method.descriptor_name]
        queries = self.queries.signatures[method.descriptor_name]
        return np.stack(
            [
                pair_distances(method, joined_signatures([places[near[:count]], queries[q : q + 1]]))
                for q, near in enumerate(self.near[:some])
            ]
        )

    def places_m(self, count: int) -> Floats:
        """Where the `count` places of each query were taken, (Q, count, 2)."""
        return self.places.position_m[self.near[:, :count], :2]

    @property
    def truth_m(self) -> Floats:
        """Where the queries were taken, (Q, 2)."""
        return self.queries.position_m[:, :2]


def short_lists(chooser: Method, places: Described, queries: Described, count: int, record: Recorder) -> ShortLists:
    """The `count` places of a map that the chooser finds most alike to each query."""
    index = prepared(chooser, places.signatures[chooser.descriptor_name], rotated=True)
    start = time.perf_counter()
    with record.timed("search", len(queries.position_m)):
        match = chooser.distance.match(queries.signatures[chooser.descriptor_name], index)
        near = match.distance.argsort(axis=1, kind="stable")[:, :count]
    return ShortLists(places, queries, near, 1e3 * (time.perf_counter() - start) / len(near))


def keeping(batches: Iterable[Frames], kept: list[tuple[Frames, int]], count: int) -> Iterator[Frames]:
    """Passes batches on, and keeps the first `count` frames, each as its batch and index."""
    for frames in batches:
        kept += [(frames, i) for i in range(min(len(frames), count - len(kept)))]
        yield frames
