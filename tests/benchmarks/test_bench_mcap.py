"""What the sink `mcap` costs: an image (below 0.2 ms), 20,000 rows (below 1 s), 100 shown queries."""

from itertools import cycle

import numpy as np
import pytest

from omnilab import api
from omnilab.geometry import planar_poses
from omnilab_mcap import McapSink

GROUP = "what the sink `mcap` writes"
ALONE = "nothing else writes these records as Foxglove's messages; both logs take 6 % of the grid study"
TICK = api.Tick(3, 300_000_000)


@pytest.fixture
def sink(tmp_path):
    sink = McapSink()
    sink.open(tmp_path)
    yield sink
    sink.close()


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.benchmark(group=GROUP)
def test_bench_mcap_image_of_10_kb(benchmark, sink, rng):
    pixels = np.zeros((250, 250), np.uint8)
    images = [api.Image(pixels, encoded=rng.bytes(10_000)) for _ in range(500)]  # as incompressible as JPEG
    queue = cycle(images)
    benchmark.extra_info["no_peer"] = ALONE
    benchmark.pedantic(lambda: sink.write("camera/image", next(queue), TICK), rounds=20, iterations=500)


@pytest.mark.benchmark(group=GROUP)
def test_bench_mcap_20000_rows(benchmark, sink, rng):
    steps = np.arange(20_000)
    series = api.Series(rng.random(20_000), steps, steps * 10**8, "m")
    benchmark.pedantic(sink.write, ("error", series, None), rounds=3)


@pytest.mark.benchmark(group=GROUP)
def test_bench_mcap_100_queries(benchmark, sink, rng):
    places_m = rng.random((1271, 3))
    pixels = np.zeros((250, 250), np.uint8)
    records = {
        "camera/image": api.Image(pixels, encoded=rng.bytes(10_000)),
        "camera/panorama": api.Image(pixels, encoded=rng.bytes(10_000)),
        "camera": api.Pose(planar_poses([1, 2, 3], 0.5)[0]),
        "signature": api.Signature(rng.random((173, 180), np.float32)),
        "distances": api.DistanceField(places_m, rng.random(1271)),
        "query": api.Estimate(places_m[0], places_m[1], "wrong"),
    }

    def hundred_queries():
        for _ in range(100):
            for path, record in records.items():
                sink.write(path, record, TICK)
        sink.flush()

    benchmark.pedantic(hundred_queries, rounds=3)
