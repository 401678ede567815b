"""One more image of 1280 x 960 in a map, everything logged, at node 100 and at node 5000; and stage by stage.

pytest tests/benchmarks/test_bench_trajectory.py --benchmark-enable -n 0 -m slow

The pictures are forty of a lap, over and over: from the second lap on every image can close a loop, the worst there is.
With a pause of four, one in five does. The thesis: 650 ms an image.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import Frames, NamedPath, Parts, Plan
from omnilab.runner.execute import pinned
from omnilab.runner.recorder import Recorder
from omnilab_appearance import GeometricVerification, PlanarEpipolar
from omnilab_mcap import McapSink
from omnilab_mirror import Mirror
from omnilab_rerun import RerunSink
from omnilab_slam import GtsamIsam2
from omnilab_studies.trajectory.mapping_run import MappingRun

LAP = 40
EIZOH = {"size": 960, "crop": 1.0, "a_mm": 23.5, "b_mm": 80.8, "rim_mm": 64.15, "margin_px": 160}


@pytest.fixture(scope="module")
def lap():
    """Pictures (LAP, 960, 1280), there and back on the square's first side, and their poses."""
    sensor = Mirror(**EIZOH)
    plan = sensor.plan(NamedPath("square"))
    half = plan.at(range(LAP // 2))
    batches = list(sensor.frames(half))
    there = replace(
        batches[0],
        images=np.concatenate([b.images for b in batches]),
        keys=[key for b in batches for key in b.keys],
        T_world_camera=np.concatenate([b.T_world_camera for b in batches]),
    )
    return there, np.r_[0 : LAP // 2, LAP // 2 - 1 : -1 : -1]


def frame(lap, node):
    there, order = lap
    i = int(order[node % LAP])
    one = slice(i, i + 1)
    return Frames(
        there.images[one],
        [f"{node}"],
        np.array([node * 10**8]),
        there.camera,
        np.array([node]),
        there.T_world_camera[one],
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("pause", [0, 4])
@pytest.mark.parametrize("nodes", [100, 5000])
def test_one_more_image(benchmark, lap, tmp_path: Path, nodes, pause):
    there, order = lap
    nodes = nodes if benchmark.enabled else nodes // 100  # minutes are for measuring
    count = nodes + 60
    T = there.T_world_camera[order[np.arange(count) % LAP]]
    parts = Parts(odometry=PlanarEpipolar(), loop_closure=GeometricVerification(pause=pause), backend=GtsamIsam2())
    with pinned(1), Recorder({"rerun": RerunSink(), "mcap": McapSink()}, tmp_path) as record:  # as runs are
        mapping = MappingRun(parts, Plan([str(i) for i in range(count)], T), record, show=count, gap=3.0)
        rng = np.random.default_rng(0)
        for node in range(nodes):
            mapping.process(frame(lap, node), rng)
        ready = iter([frame(lap, node) for node in range(nodes, count)])
        benchmark.pedantic(lambda one: mapping.process(one, rng), setup=lambda: ((next(ready),), {}), rounds=50)
    benchmark.extra_info["closures"] = len(mapping.closures)
