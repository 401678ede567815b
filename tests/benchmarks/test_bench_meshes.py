"""Rays a second of whole images of a mesh, traced and shaded, beside embreex on the same rays; and how long large meshes take to load."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from omnilab.api import RandomPoses
from omnilab_mirror import Mirror
from omnilab_mirror.render.embree import bundle_of
from omnilab_mirror.render.prepared_world import embree_of
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.meshes.mesh_world import world_of_mesh

BOOKSTORE = Path(__file__).parents[3] / "shared/data/aws_bookstore/bookstore.obj"
IMAGES = 16
GROUP = "bookstore, 118,189 triangles, 16 images of 250 x 250, one ray a pixel"
COLUMNS, ROWS = 2501, 2001
LARGE = "a mesh of 10 million triangles, read from {}"
KINDS = ("ply", "glb", "obj")

of_bookstore = pytest.mark.skipif(not BOOKSTORE.is_file(), reason="the bookstore is not in ../shared/data")


@of_bookstore
@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("color", [False, True], ids=["grey", "colour"])
def test_bench_meshes(benchmark, color):
    sensor = Mirror(world=str(BOOKSTORE), color=color, samples=1)
    plan = sensor.plan(RandomPoses(IMAGES, seed=1))
    count = IMAGES * len(bundle_of(sensor.camera, 1).pixel) / 1e6
    benchmark.extra_info.update(what="`mirror`, colour" if color else "`mirror`", count=count, unit="a million rays")
    images = benchmark.pedantic(lambda: next(sensor.frames(plan)).images, rounds=5, warmup_rounds=1)
    assert len(images) == IMAGES


@of_bookstore
@pytest.mark.benchmark(group=GROUP)
def test_bench_embree_alone(benchmark):
    sensor = Mirror(world=str(BOOKSTORE), samples=1)
    bundle, scene, rays = bundle_of(sensor.camera, 1), EmbreeScene(), []
    TriangleMesh(scene, load_world(str(BOOKSTORE)).meshes[0].corners)
    row_by_row = bundle.direction[:, np.argsort(bundle.pixel)]
    for T in sensor.plan(RandomPoses(IMAGES, seed=1)).T_world_camera.astype(np.float32):
        direction = np.ascontiguousarray((T[:3, :3] @ row_by_row).T)
        rays.append((np.tile(T[:3, 3], (len(direction), 1)), direction))

    def alone():
        for origin, direction in rays:
            scene.run(origin, direction)

    benchmark.extra_info.update(peer="embree alone, unshaded", count=IMAGES * len(bundle.pixel) / 1e6)
    benchmark.pedantic(alone, rounds=5, warmup_rounds=1)


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    """A hall of 25 x 20 m with a floor of bumps, a grid of 10 million triangles, in each kind of file."""
    folder = tmp_path_factory.mktemp("large")
    x, y = np.meshgrid(np.linspace(-12.5, 12.5, COLUMNS), np.linspace(-10, 10, ROWS))
    z = 0.1 * np.sin(2 * x) * np.cos(3 * y) + 3 * np.maximum(np.abs(x) - 11, 0) + 3 * np.maximum(np.abs(y) - 8.5, 0)
    corner = (np.arange(ROWS - 1)[:, None] * COLUMNS + np.arange(COLUMNS - 1)).reshape(-1, 1)
    faces = (corner + np.array([0, 1, COLUMNS + 1, 0, COLUMNS + 1, COLUMNS])).reshape(-1, 3)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).round(6)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for kind in ("ply", "glb"):
        mesh.export(folder / f"hall.{kind}")
    with (folder / "hall.obj").open("w") as out:  # trimesh takes two minutes
        for rows, line in ((vertices, "v %.6f %.6f %.6f\n"), (faces + 1, "f %d %d %d\n")):
            out.writelines(line * len(part) % tuple(part.ravel().tolist()) for part in np.array_split(rows, 100))
    return folder


@pytest.mark.slow
@pytest.mark.timeout(900)  # whichever is first makes the files
@pytest.mark.parametrize("tree", [False, True], ids=["read", "with its tree"])
@pytest.mark.parametrize("kind", KINDS)
def test_bench_large_meshes(benchmark, large, kind, tree):
    def loaded():
        world = world_of_mesh(large / f"hall.{kind}", up="z")
        return embree_of(world).triangles if tree else world.meshes[0]

    benchmark.group = LARGE.format(kind.upper())
    benchmark.extra_info.update(what="`mirror`, with Embree's tree" if tree else "`mirror`")
    assert len(benchmark.pedantic(loaded, rounds=3)) == 10_000_000


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", KINDS)
def test_bench_large_meshes_by_trimesh(benchmark, large, kind):
    def loaded():
        return trimesh.load(large / f"hall.{kind}", process=False, force="mesh")

    benchmark.group = LARGE.format(kind.upper())
    benchmark.extra_info.update(peer="`trimesh.load`")

    def tidy():
        gc.collect()  # it leaves cycles behind, and the collector is off while a round runs

    assert len(benchmark.pedantic(loaded, setup=tidy, rounds=3).faces) == 10_000_000
