"""Images a second of the mirror in the furnished room, beside the same rays in plain numpy, one image at a time."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import RandomPoses
from omnilab_mirror import Conical, Equirectangular, Mirror, Pinhole, Spherical, Stereo
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.scene.load import load_world

IMAGES = 16


@pytest.fixture(scope="module")
def poses():
    return RandomPoses(IMAGES, seed=1)


GROUP = "mirror, 16 images of 250 x 250"


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("color", [False, True], ids=["grey", "colour"])
def test_bench_mirror(benchmark, poses, samples, color):
    sensor = Mirror(samples=samples, color=color)
    plan = sensor.plan(poses)
    images = benchmark.pedantic(lambda: next(sensor.frames(plan)).images, rounds=3, warmup_rounds=1)
    assert len(images) == IMAGES
    name = "`mirror`, colour" if color else "`mirror`"
    benchmark.extra_info.update(
        what=name, size=samples, of=f"ray{'s' * (samples > 1)} a pixel", count=IMAGES, unit="an image"
    )


@pytest.mark.benchmark(group="virtual cameras, 16 grey images of about 250 x 250, one sample")
@pytest.mark.parametrize("sensor", [
    Mirror(samples=1, crop=1.0), Equirectangular(samples=1, width=352, height=176), Pinhole(samples=1, width=250, height=250),
    Spherical(samples=1), Conical(samples=1), Stereo(samples=1, width=352, height=176), Mirror(samples=1, crop=1.0, depth=True),
], ids=lambda sensor: type(sensor).__name__.lower() + ("+depth" if sensor.depth else ""))  # fmt: skip
def test_bench_cameras(benchmark, poses, sensor):
    plan = sensor.plan(poses)
    images = benchmark.pedantic(lambda: next(sensor.frames(plan)).images, rounds=3, warmup_rounds=1)
    assert len(images) == IMAGES
    why = "other renderers know none of these worlds; the mirror stands beside plain numpy, and meshes beside embree"
    benchmark.extra_info.update(count=IMAGES, unit="an image", no_peer=why)


@pytest.mark.benchmark(group=GROUP)
def test_bench_mirror_in_numpy(benchmark, poses):
    sensor = Mirror(samples=1)
    plan = sensor.plan(poses)
    image = benchmark.pedantic(numpy_image, (sensor, plan.T_world_camera[0]), rounds=2)
    benchmark.extra_info.update(peer="every ray against every face, in numpy", size=1, of="ray a pixel")
    traced = next(sensor.frames(plan.at([0]))).images[0]
    assert np.median(np.abs(image.astype(int) - traced)) <= 6  # it takes the nearest texel, unfiltered


def numpy_image(sensor: Mirror, T_world_camera):
    """A grey image of one sample a pixel, every ray against every face."""
    v, u = np.mgrid[: sensor.size, : sensor.size]
    d = sensor.camera.directions(np.stack([u, v], -1).astype(float)) @ T_world_camera[:3, :3].T
    nearest, image = np.zeros(d.shape[:2]), np.zeros(d.shape[:2], np.uint8)
    world = load_world(sensor.world)
    for face, picture in zip(world.quads, baked_pictures(world), strict=True):
        w, x, y = np.moveaxis(
            d @ np.linalg.inv(np.stack([face.corner - T_world_camera[:3, 3], face.u, face.v], 1)).T, -1, 0
        )
        hit = (w > nearest) & (x >= 0) & (x <= w) & (y >= 0) & (y <= w)
        rows, columns = (
            np.minimum((f[hit] / w[hit] * n).astype(int), n - 1) for f, n in zip((y, x), picture.shape, strict=False)
        )
        nearest[hit], image[hit] = w[hit], picture[rows, columns] @ [0.299, 0.587, 0.114]
    return image


@pytest.mark.benchmark(group=GROUP)
def test_bench_mirror_in_a_loop(benchmark, poses):
    sensor = Mirror(samples=1, size=24)
    plan = sensor.plan(poses)
    image = benchmark.pedantic(loop_image, (sensor, plan.T_world_camera[0]), rounds=2)
    assert np.median(np.abs(image.astype(int) - numpy_image(sensor, plan.T_world_camera[0]))) <= 1
    name = "the thesis's loop in Python, by its time for 24 x 24"
    benchmark.extra_info.update(peer=name, size=1, of="ray a pixel", count=(24 / 250) ** 2)


def loop_image(sensor: Mirror, T_world_camera):
    """A grey image as the thesis's listings make it: pixel by pixel, face by face."""
    world = load_world(sensor.world)
    inverses = [np.linalg.inv(np.stack([f.corner - T_world_camera[:3, 3], f.u, f.v], 1)).tolist() for f in world.quads]
    image = np.zeros((sensor.size, sensor.size), np.uint8)
    for v in range(sensor.size):
        for u in range(sensor.size):
            d = (T_world_camera[:3, :3] @ sensor.camera.directions(np.array([u, v], float))).tolist()
            nearest = 0.0
            for (r0, r1, r2), picture in zip(inverses, baked_pictures(world), strict=True):
                w = r0[0] * d[0] + r0[1] * d[1] + r0[2] * d[2]
                x = r1[0] * d[0] + r1[1] * d[1] + r1[2] * d[2]
                y = r2[0] * d[0] + r2[1] * d[1] + r2[2] * d[2]
                if w > nearest and 0 <= x <= w and 0 <= y <= w:
                    nearest, (height, width) = w, picture.shape[:2]
                    texel = picture[min(int(y / w * height), height - 1), min(int(x / w * width), width - 1)]
                    image[v, u] = texel @ [0.299, 0.587, 0.114]
    return image
