"""One query at a time: hierarchical beside exhaustive search, and what a position between the places costs on top."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Places, Signatures
from omnilab.geometry import planar_poses
from omnilab_appearance import Cosine, Hierarchical, Interpolated, Nearest

QUERIES, SIZES = 50, (1_000, 3_000, 10_000, 30_000, 100_000)
RNG = np.random.default_rng(0)
WAVES = RNG.standard_normal((2, 256))


def signatures(position_m):
    """256 smooth functions of the position: neighbours are alike, and places far apart are not."""
    return Signatures(np.abs(np.sin(position_m[:, :2] @ WAVES + np.arange(256))).astype(np.float32))


def locate_each(localizer, queries, index):
    return np.concatenate([localizer.locate(queries[q : q + 1], index).place for q in range(QUERIES)])


@pytest.mark.parametrize(
    "localizer", [Nearest(), Hierarchical(), Interpolated()], ids=["nearest", "hierarchical", "interpolated"]
)
@pytest.mark.parametrize("count", SIZES)
@pytest.mark.benchmark(group="one query, places of 256 numbers each")
def test_bench_one_query(benchmark, localizer, count):
    count = count if benchmark.enabled else SIZES[0]
    position_m = RNG.uniform(0, 8, (count, 3))
    places = Places(signatures(position_m), planar_poses(position_m), [""] * count)
    queries = signatures(RNG.uniform(0, 8, (QUERIES, 3)))
    index = localizer.prepare(places, Cosine())
    found = benchmark.pedantic(locate_each, (localizer, queries, index), rounds=5, warmup_rounds=1)
    exact = Cosine().match(queries, Cosine().prepare(places.signatures)).distance.argmin(axis=1)
    assert np.mean(found == exact) > 0.9
    name = f"`{type(localizer).__name__.lower()}`"
    benchmark.extra_info.update(what=name, size=count, of="places", count=QUERIES, unit="a query")


@pytest.mark.benchmark(group="one query, places of 256 numbers each")
@pytest.mark.parametrize("count", SIZES)
def test_bench_one_query_in_numpy(benchmark, count):
    """All cosines at once."""
    count = count if benchmark.enabled else SIZES[0]
    position_m = RNG.uniform(0, 8, (count, 3))
    places, queries = (
        found.place / np.linalg.norm(found.place, axis=1, keepdims=True)
        for found in (signatures(position_m), signatures(position_m[:QUERIES]))
    )

    def locate():
        return [int((places @ query).argmax()) for query in queries]

    assert benchmark.pedantic(locate, rounds=5, warmup_rounds=1) == list(range(QUERIES))
    benchmark.extra_info.update(peer="`places @ query`, numpy", size=count, of="places", count=QUERIES)


@pytest.mark.benchmark(group="preparing `hierarchical` for 30,000 places")
def test_bench_prepare_hierarchical(benchmark):
    position_m = RNG.uniform(0, 8, (30_000, 3))
    places = Places(signatures(position_m), planar_poses(position_m), [""] * 30_000)
    benchmark.extra_info["no_peer"] = "k-means of libraries ends elsewhere; what it saves is a query's time, above"
    index = benchmark.pedantic(Hierarchical().prepare, (places, Cosine()), rounds=2)
    assert len(index.members) == 346
