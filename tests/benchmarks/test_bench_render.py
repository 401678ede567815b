"""What it costs to take pictures from one camera to another, and to write a data set."""

import numpy as np
import pytest

from omnilab.api import GridPoses
from omnilab.cameras import CylindricalCamera, HyperbolicMirror, reproject
from omnilab_mirror import Mirror
from omnilab_studies.common.dataset_files import DataSet

COUNT = 16


@pytest.mark.parametrize("samples", [1, 4])
def test_reproject_a_mirror_image(benchmark, samples):
    """Of 250 x 250 to 512 x 128, the maps being there."""
    images = np.random.default_rng(0).integers(0, 255, (COUNT, 250, 250), np.uint8)
    camera, target = HyperbolicMirror(), CylindricalCamera(512, 128)
    assert benchmark(reproject, images, camera, target, None, samples).shape == (COUNT, 128, 512)


def test_write_images(benchmark, tmp_path):
    """Encoding and writing, beside which rendering is to be seen (test_bench_mirror)."""
    mirror, data = Mirror(samples=1), DataSet(tmp_path)
    (frames,) = mirror.frames(mirror.plan(GridPoses(1.0)).at(range(COUNT)))
    data.open({})

    def write():
        for n, image in enumerate(frames.images):
            data.write(n, image, None)

    benchmark(write)
    assert np.array_equal(data.read(3), frames.images[3])
