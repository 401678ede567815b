"""One query at a time: hierarchical beside exhaustive search, and what a position between the places costs on top."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Places, Signatures
from omnilab.geometry import planar_poses
from omnilab_appearance import Cosine, Hierarchical, Interpolated, Nearest

QUERIES = 50
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
@pytest.mark.parametrize("count", [3_000, 30_000])
def test_bench_one_query(benchmark, localizer, count):
    benchmark.group = f"one query among {count} places, 256 numbers each"
    position_m = RNG.uniform(0, 8, (count, 3))
    places = Places(signatures(position_m), planar_poses(position_m), [""] * count)
    queries = signatures(RNG.uniform(0, 8, (QUERIES, 3)))
    index = localizer.prepare(places, Cosine())
    found = benchmark.pedantic(locate_each, (localizer, queries, index), rounds=5, warmup_rounds=1)
    exact = Cosine().match(queries, Cosine().prepare(places.signatures)).distance.argmin(axis=1)
    assert np.mean(found == exact) > 0.9
    if benchmark.stats:
        benchmark.extra_info["ms_per_query"] = 1e3 * benchmark.stats.stats.median / QUERIES


def test_bench_prepare_hierarchical(benchmark):
    position_m = RNG.uniform(0, 8, (30_000, 3))
    places = Places(signatures(position_m), planar_poses(position_m), [""] * 30_000)
    index = benchmark.pedantic(Hierarchical().prepare, (places, Cosine()), rounds=3, warmup_rounds=1)
    assert len(index.members) == 346
