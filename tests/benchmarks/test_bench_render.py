"""What it costs to take pictures from one camera to another, and to write a data set."""

import cv2
import numpy as np
import pytest

from omnilab.api import GridPoses
from omnilab.cameras import CylindricalCamera, HyperbolicMirror, reproject
from omnilab.runner.cache import DiskCache
from omnilab_mirror import Mirror
from omnilab_studies.common.dataset_files import DataSet

COUNT = 16


@pytest.mark.benchmark(group="a mirror image of 250 x 250 to a panorama of 512 x 128, the maps being there")
@pytest.mark.parametrize("samples", [1, 4])
def test_reproject_a_mirror_image(benchmark, samples):
    images = np.random.default_rng(0).integers(0, 255, (COUNT, 250, 250), np.uint8)
    camera, target = HyperbolicMirror(), CylindricalCamera(512, 128)
    reproject(images[:1], camera, target, None, samples)
    found = benchmark.pedantic(reproject, (images, camera, target, None, samples), rounds=20)
    of = f"sample{'s' * (samples > 1)} a pixel"
    benchmark.extra_info.update(what="`reproject`", count=COUNT, unit="an image", size=samples, of=of)
    assert found.shape == (COUNT, 128, 512)


@pytest.mark.benchmark(group="a mirror image of 250 x 250 to a panorama of 512 x 128, the maps being there")
def test_reproject_by_opencv(benchmark):
    """It says nothing of what the mirror does not show."""
    image = np.random.default_rng(0).integers(0, 255, (250, 250), np.uint8)
    camera, target = HyperbolicMirror(), CylindricalCamera(512, 128)
    v, u = np.indices((128, 512))
    maps = np.nan_to_num(camera.pixels(target.directions(np.stack([u, v], -1).astype(float))), nan=-1e4).astype(
        np.float32
    )
    picture = benchmark(cv2.remap, image, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
    benchmark.extra_info.update(peer="`cv2.remap`", size=1, of="sample a pixel")
    ours = reproject(image[None], camera, target)[0]
    assert np.median(np.abs(ours[ours > 0].astype(int) - picture[ours > 0])) <= 1


@pytest.mark.benchmark(group="a mirror image of 250 x 250 that was rendered before")
def test_renderings_from_the_cache(benchmark, tmp_path):
    mirror = Mirror(samples=1)
    plan = mirror.plan(GridPoses(1.0)).at(range(COUNT))
    whole = next(DiskCache(tmp_path, 10**9, 1).wrap(mirror).frames(plan)).images
    found = benchmark.pedantic(
        lambda: next(DiskCache(tmp_path, 10**9, 1).wrap(mirror).frames(plan)).images, rounds=10, warmup_rounds=1
    )
    benchmark.extra_info.update(what="the cache, opened anew", count=COUNT, unit="an image")
    assert np.array_equal(found, whole)


@pytest.mark.benchmark(group="a mirror image of 250 x 250 that was rendered before")
def test_renderings_anew(benchmark):
    mirror = Mirror(samples=1)
    plan = mirror.plan(GridPoses(1.0)).at(range(COUNT))
    benchmark.pedantic(lambda: next(mirror.frames(plan)), rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(peer="rendering it anew", count=COUNT, unit="an image")


@pytest.mark.benchmark(group="writing an image of a data set as PNG")
def test_write_images(benchmark, tmp_path):
    """Encoding and writing, beside which rendering is to be seen (test_bench_mirror)."""
    mirror, data = Mirror(samples=1), DataSet(tmp_path)
    (frames,) = mirror.frames(mirror.plan(GridPoses(1.0)).at(range(COUNT)))
    data.open({})

    def write():
        for n, image in enumerate(frames.images):
            data.write(n, image, None)

    benchmark.pedantic(write, rounds=10, warmup_rounds=1)
    benchmark.extra_info.update(what="`dataset`", count=COUNT, unit="an image")
    assert np.array_equal(data.read(3), frames.images[3])


@pytest.mark.benchmark(group="writing an image of a data set as PNG")
def test_write_images_by_opencv(benchmark, tmp_path):
    mirror = Mirror(samples=1)
    (frames,) = mirror.frames(mirror.plan(GridPoses(1.0)).at(range(COUNT)))

    def write():
        for n, image in enumerate(frames.images):
            cv2.imwrite(str(tmp_path / f"{n}.png"), image)

    benchmark.pedantic(write, rounds=10, warmup_rounds=1)
    benchmark.extra_info.update(peer="`cv2.imwrite`", count=COUNT)
