"""Relative altitude of one pair of 717 x 717 images, beside the printed equations in plain numpy.

pytest tests/benchmarks/test_bench_altitude.py --benchmark-enable -n 0
"""

import numpy as np
import pytest

from omnilab.api import PathPoses
from omnilab.geometry import planar_poses
from omnilab.image import view_of
from omnilab_appearance import FeatureAltitude, FloorAndWalls, Radon, RadonCompression
from omnilab_appearance.altimeters.radon_compression import compressions
from omnilab_appearance.common.local_features import Detector
from omnilab_mirror import Mirror

OFFSETS, ANGLES = 680, 300  # 204,000 components
COUNT = int(RadonCompression().most * OFFSETS) + 1


@pytest.fixture(scope="module")
def pair():
    sensor = Mirror(size=717)
    plan = sensor.plan(PathPoses(planar_poses([[0.0, -0.4, 1.25], [0.0, -0.4, 1.85]], [0.0, 1.0])))
    frames = next(iter(sensor.frames(plan)))
    return frames.images[:1], frames.images[1:], frames.camera


@pytest.fixture(scope="module")
def transforms(pair):
    reference, test, camera = pair
    views = view_of(np.concatenate([reference, test]), camera, "mirror", False)
    return Radon(OFFSETS, ANGLES).describe(views).place


def plain(still, squeezed):
    """Equations 5.5 to 5.9, a column at a time."""
    n, distances = len(still), np.empty(COUNT)
    for a in range(COUNT):
        rows = n - 2 * a
        at, grid = np.arange(1, rows + 1) * n / rows, np.arange(1, n + 1)
        compressed = np.empty((rows, ANGLES))
        for column in range(ANGLES):
            compressed[:, column] = np.interp(at, grid, squeezed[:, column])
        middle = still[a : n - a]
        apart = middle / middle.max(axis=1, keepdims=True) - compressed / compressed.max(axis=1, keepdims=True)
        distances[a] = np.abs(apart).mean()
    return distances


@pytest.mark.benchmark(group="both cases of the compression, 680 x 300")
def test_compression(benchmark, transforms):
    reference, test = transforms[:1], transforms[1:]
    compressions(reference, test, 2)  # compile
    falling, rising = benchmark(compressions, reference, test, COUNT)
    assert np.allclose(falling, plain(*transforms), rtol=1e-4)
    assert np.allclose(rising, plain(*transforms[::-1]), rtol=1e-4)


@pytest.mark.benchmark(group="both cases of the compression, 680 x 300")
def test_compression_by_numpy_interp(benchmark, transforms):
    first, second = transforms.astype(float)
    benchmark.extra_info["peer"] = "the printed equations, column by column with `numpy.interp`"
    benchmark.pedantic(lambda: (plain(first, second), plain(second, first)), rounds=2)


@pytest.mark.benchmark(group="an estimate from two images of 717 x 717")
@pytest.mark.parametrize(
    "altimeter",
    [RadonCompression(OFFSETS, ANGLES), FeatureAltitude(), FeatureAltitude(Detector.sift), FloorAndWalls()],
    ids=["radon_compression", "surf", "sift", "floor_and_walls"],
)
def test_estimate(benchmark, pair, altimeter):
    told = altimeter.relative(*pair)  # compile
    assert told.value[0] > 0
    benchmark.extra_info["no_peer"] = "no library tells an altitude from two images; what is numbers in it is above"
    benchmark.pedantic(altimeter.relative, pair, rounds=5)
