"""What the sink `rerun` adds to a run."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from omnilab.api import DistanceField, Estimate, Image, Pose, Series, Signature, Tick
from omnilab.geometry import planar_poses
from omnilab.image import encode
from omnilab_rerun import RerunSink

GROUP = "what the sink `rerun` writes"
ALONE = "nothing else writes these records for Rerun; both logs take 6 % of the grid study"


@pytest.fixture
def sink(tmp_path):
    sink = RerunSink()
    sink.open(tmp_path)
    yield sink
    sink.close()


@pytest.mark.benchmark(group=GROUP)
def test_write_and_flush_one_shown_query(benchmark, sink):
    """Two pictures, a 173 x 180 signature, the field over 41 x 31 places, the estimate and the pose."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(41) * 0.2, np.arange(31) * 0.2)
    places = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], -1)
    picture, unwrapped = (rng.integers(0, 255, shape, np.uint8) for shape in ((250, 250, 3), (128, 512, 3)))
    records = {
        "image": Image(picture, encoded=encode(picture)),
        "panorama": Image(unwrapped, encoded=encode(unwrapped)),
        "signature": Signature(rng.random((173, 180), np.float32)),
        "distance": DistanceField(places, rng.random(len(places), np.float32)),
        "estimate": Estimate(places[0], places[9], "wrong"),
        "camera": Pose(planar_poses(places[0])[0]),
    }
    steps = itertools.count()

    def write() -> None:
        step = next(steps)
        for path, record in records.items():
            sink.write(path, record, Tick(step, step))
        sink.flush()

    benchmark.extra_info["no_peer"] = ALONE
    benchmark.pedantic(write, rounds=20, warmup_rounds=1)


@pytest.mark.benchmark(group=GROUP)
def test_write_and_flush_3500_rows(benchmark, sink):
    steps = np.arange(3500)
    series = Series(np.sqrt(steps), steps, steps * 100_000_000, "m")

    def write() -> None:
        sink.write("error", series, None)
        sink.flush()

    benchmark.extra_info["no_peer"] = ALONE
    benchmark.pedantic(write, rounds=20, warmup_rounds=1)
