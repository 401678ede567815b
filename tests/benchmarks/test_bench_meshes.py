"""Rays a second of whole images of a mesh, traced and shaded, beside embree alone on the same rays in the same run."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import RandomPoses
from omnilab_mirror import Mirror
from omnilab_mirror.render.embree import bundles_of
from omnilab_mirror.render.prepared_world import embree_of
from omnilab_mirror.scene.load import load_world

BOOKSTORE = Path(__file__).parents[3] / "shared/data/aws_bookstore/bookstore.obj"
IMAGES, ROUNDS = 32, 5

pytestmark = pytest.mark.skipif(not BOOKSTORE.is_file(), reason="the bookstore is not in ../shared/data")


def seconds(work) -> tuple[float, float]:
    """Wall and processor time."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - processor


@pytest.mark.benchmark(group="bookstore, 118,189 triangles, 32 images of 250 x 250, one ray a pixel")
@pytest.mark.parametrize("color", [False, True], ids=["grey", "colour"])
def test_bench_meshes(benchmark, color):
    sensor = Mirror(world=str(BOOKSTORE), color=color, samples=1)
    plan, embree = sensor.plan(RandomPoses(IMAGES, seed=1)), embree_of(load_world(str(BOOKSTORE)))
    (bundle,) = bundles_of(sensor.camera, 1)
    rays = [embree.trace(bundle, T) for T in plan.T_world_camera]

    def whole():
        return next(sensor.frames(plan)).images

    def alone():
        for hits in rays:
            embree.scene.run(hits.origin, hits.direction)

    assert len(benchmark.pedantic(whole, rounds=1, warmup_rounds=1)) == IMAGES
    # in turn, so that what else the machine does slows both alike
    times = np.array([(*seconds(whole), *seconds(alone)) for _ in range(ROUNDS if benchmark.stats else 1)])
    wall, processor, alone_wall, alone_processor = np.median(times, axis=0)
    benchmark.extra_info["rays_per_s"] = IMAGES * len(bundle.pixel) / wall
    benchmark.extra_info["embree_rays_per_s"] = IMAGES * len(bundle.pixel) / alone_wall
    benchmark.extra_info["of_embree"] = float(np.median(times[:, 2] / times[:, 0]))
    benchmark.extra_info["of_embree_by_processor_time"] = alone_processor / processor
