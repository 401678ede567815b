"""Maps of up to a million places: `hierarchical` beside exhaustive search, FAISS and hnswlib, one query at a time.

pytest tests/benchmarks/large_maps --benchmark-enable -n 0 -m slow --benchmark-json=FILE

(pip install faiss-cpu hnswlib, for the peers.)

Signatures are those of `experiment=large_map`, 32 rows of 8 magnitudes, of a random field with the statistics of rendered
ones (synthetic_places.py), on a square grid 0.05 m apart; queries are taken between the places. All search by the cosine, on
one thread. `extra_info` has `build_s`, in seconds of the processor, the memory of the
index beside the signatures, the most that the process held, and the share of answers that are the `same` as the exact nearest.
"""

from __future__ import annotations

import time
from pathlib import Path
from resource import RUSAGE_SELF, getrusage

import numpy as np
import pytest
from synthetic_places import LAGS_M, field_like, mean_distances

from omnilab.api import Places, RandomPoses, Signatures
from omnilab.geometry import planar_poses
from omnilab.image import view_of
from omnilab_appearance import Cosine, FourierSignature, Hierarchical
from omnilab_appearance.common.circular_correlation import blas
from omnilab_appearance.common.vectors import unit
from omnilab_mirror import Mirror

STEP_M, QUERIES = 0.05, 200
SIDES = [316, 1000]  # places along a side
PAGE = 4096
CLUSTERS, PROBES = 2000, 8  # of FAISS; `hierarchical` has 2 sqrt(P) by itself
LINKS, BREADTH, WIDTH = 16, 100, 256  # of the graph: neighbours of a place, candidates in building and in search


def of_ours(places, position_m):
    T = planar_poses(np.c_[position_m, np.zeros(len(places))])
    index = Hierarchical().prepare(Places(Signatures(places), T, [""] * len(places)), Cosine())
    return lambda query: Hierarchical().locate(Signatures(query), index).place[0]


def of_faiss_flat(places, _):
    index = pytest.importorskip("faiss").IndexFlatIP(places.shape[1])
    index.add(unit(places))
    return lambda query: index.search(unit(query), 1)[1][0, 0]


def of_faiss_lists(places, _):
    faiss = pytest.importorskip("faiss")
    clusters = min(CLUSTERS, len(places) // 50)
    index = faiss.IndexIVFFlat(
        faiss.IndexFlatIP(places.shape[1]), places.shape[1], clusters, faiss.METRIC_INNER_PRODUCT
    )
    index.cp.max_points_per_centroid, index.nprobe = 64, PROBES
    normed = unit(places)
    index.train(normed)
    index.add(normed)
    return lambda query: index.search(unit(query), 1)[1][0, 0]


def of_hnswlib(places, _):
    index = pytest.importorskip("hnswlib").Index("cosine", places.shape[1])
    index.init_index(len(places), M=LINKS, ef_construction=BREADTH, random_seed=0)
    index.set_num_threads(1)
    index.add_items(places)
    index.set_ef(WIDTH)
    return lambda query: index.knn_query(query, 1)[0][0, 0]


BUILDERS = {
    "hierarchical": of_ours, "faiss, exhaustive": of_faiss_flat, "faiss, inverted lists": of_faiss_lists, "hnswlib": of_hnswlib
}  # fmt: skip


@pytest.fixture(scope="module")
def rendered(request):
    """Signatures (N, D), at unit length, and positions (N, 2) in the room."""
    sensor, descriptor = Mirror(size=128, samples=1, batch=256), FourierSignature(rows=32, magnitudes=8, phases=4)
    count = 4000 if request.config.getoption("benchmark_enable") else 300
    batches = list(sensor.frames(sensor.plan(RandomPoses(count, seed=1))))
    places = [descriptor.describe(view_of(each.images, each.camera, "panorama", False)).place for each in batches]
    position_m = np.concatenate([each.T_world_camera[:, :2, 3] for each in batches])
    return unit(np.concatenate(places).reshape(len(position_m), -1)), position_m


@pytest.fixture(scope="module", params=SIDES)
def search(request, rendered):
    """Places (P, D), their positions, queries (Q, D), and the exact nearest place of each."""
    side = request.param
    if not request.config.getoption("benchmark_enable"):
        if side != SIDES[0]:
            pytest.skip("benchmarks are off (--benchmark-enable)")
        side = 40
    field = field_like(*rendered, seed=0)
    position_m = STEP_M * np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    places = field.at(position_m)
    queries = field.at(np.random.default_rng(1).uniform(0, STEP_M * (side - 1), (QUERIES, 2)))
    nearest, exact = np.full(QUERIES, -np.inf), np.zeros(QUERIES, int)
    for start in range(0, len(places), 50_000):
        cosine = unit(queries) @ unit(places[start : start + 50_000]).T
        closer = cosine.max(axis=1) > nearest
        exact[closer] = start + cosine.argmax(axis=1)[closer]
        nearest = np.maximum(nearest, cosine.max(axis=1))
    return places, position_m, queries, exact


@pytest.mark.slow
@pytest.mark.benchmark(group="a field with the statistics of rendered signatures")
def test_bench_statistics_are_those_of_rendered_places(benchmark, rendered):
    signatures, position_m = rendered
    field = benchmark.pedantic(field_like, (signatures, position_m, 0), rounds=1)
    windows = [field.at(position_m + shift) for shift in 20.0 * np.stack(np.divmod(np.arange(9), 3), axis=1)]
    ours = np.mean([mean_distances(window, position_m) for window in windows], axis=0)
    theirs = mean_distances(signatures, position_m)
    benchmark.extra_info |= {
        "pairs_up_to_m": LAGS_M[1:].tolist(),
        "rendered": theirs.tolist(),
        "synthetic": ours.tolist(),
        "no_peer": "it is what searches among a million places are measured on",
    }
    np.testing.assert_allclose(ours[:6], theirs[:6], rtol=0.2)  # to 0.5 m: what search lives by
    np.testing.assert_allclose(ours, theirs, rtol=0.4)
    np.testing.assert_allclose(windows[0].mean(axis=0), signatures.mean(axis=0), atol=0.05)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.benchmark(group="one query, signatures with the statistics of rendered ones")
@pytest.mark.parametrize("name", BUILDERS)
def test_bench_search(benchmark, search, name):
    places, position_m, queries, exact = search
    with blas().limit(limits=1):  # of OpenMP, too
        memory, start = resident(), time.process_time()
        find = BUILDERS[name](places, position_m)
        build_s, memory = time.process_time() - start, resident() - memory
        found = benchmark.pedantic(lambda: [find(queries[q : q + 1]) for q in range(QUERIES)], rounds=2)
    same = float(np.mean(found == exact))
    assert same >= 0.9
    named = {"what": f"`{name}`"} if name == "hierarchical" else {"peer": name}
    benchmark.extra_info |= named | {"size": len(places), "of": "places", "count": QUERIES, "unit": "a query"}
    peak_mb = getrusage(RUSAGE_SELF).ru_maxrss / 1e3
    benchmark.extra_info |= {"build_s": build_s, "memory_mb": memory / 1e6, "peak_mb": peak_mb, "same": same}


def resident():
    """Bytes that the process holds now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE
