"""Rays a second of whole images of a mesh, traced and shaded, beside embree alone on the same rays."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.api import RandomPoses
from omnilab_mirror import Mirror
from omnilab_mirror.render.embree import bundles_of
from omnilab_mirror.render.prepared_world import embree_of
from omnilab_mirror.scene.load import load_world

BOOKSTORE = Path(__file__).parents[3] / "shared/data/aws_bookstore/bookstore.obj"
IMAGES = 16
GROUP = "bookstore, 118,189 triangles, 16 images of 250 x 250, one ray a pixel"

pytestmark = pytest.mark.skipif(not BOOKSTORE.is_file(), reason="the bookstore is not in ../shared/data")


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("color", [False, True], ids=["grey", "colour"])
def test_bench_meshes(benchmark, color):
    sensor = Mirror(world=str(BOOKSTORE), color=color, samples=1)
    plan = sensor.plan(RandomPoses(IMAGES, seed=1))
    (bundle,) = bundles_of(sensor.camera, 1)
    count = IMAGES * len(bundle.pixel) / 1e6
    benchmark.extra_info.update(what="`mirror`, colour" if color else "`mirror`", count=count, unit="a million rays")
    images = benchmark.pedantic(lambda: next(sensor.frames(plan)).images, rounds=5, warmup_rounds=1)
    assert len(images) == IMAGES


@pytest.mark.benchmark(group=GROUP)
def test_bench_embree_alone(benchmark):
    sensor = Mirror(world=str(BOOKSTORE), samples=1)
    embree, (bundle,) = embree_of(load_world(str(BOOKSTORE))), bundles_of(sensor.camera, 1)
    rays = [embree.trace(bundle, T) for T in sensor.plan(RandomPoses(IMAGES, seed=1)).T_world_camera]

    def alone():
        for hits in rays:
            embree.scene.run(hits.origin, hits.direction)

    benchmark.extra_info.update(peer="embree alone, unshaded", count=IMAGES * len(bundle.pixel) / 1e6)
    benchmark.pedantic(alone, rounds=5, warmup_rounds=1)
