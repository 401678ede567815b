"""Radon transform and phase correlation beside what a user would write today.

pytest tests/benchmarks --benchmark-enable -n 0
"""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.registration import phase_cross_correlation
from skimage.transform import radon

from omnilab.api import Signatures
from omnilab.cameras import THESIS_HALF, CylindricalCamera, EquirectangularCamera
from omnilab.image import view_of
from omnilab_appearance import Poc, PocBand, Radon

PLACES = (318, 636, 1271, 2542, 4291)  # the thesis's 8 x 6 m: 1271 at 0.2 m, and 4291 at 0.1 m


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(0)
    noise = np.stack([gaussian_filter(rng.standard_normal((250, 250)), 2) for _ in range(128)])
    return np.clip(127 + 50 * noise / noise.std(), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def places(request):
    """All where they are measured; each a sum of two of a few hundred, which is faster than to smooth each."""
    count = PLACES[-1] if request.config.getoption("benchmark_enable") else PLACES[0]
    rng = np.random.default_rng(1)
    few = gaussian_filter(rng.standard_normal((200, 173, 180), np.float32), (0, 3, 3))
    return Signatures(few[rng.integers(200, size=count)] + few[rng.integers(200, size=count)])


@pytest.mark.benchmark(group="Radon 173 x 180 of 250 x 250 images")
def test_radon_batch_of_128(benchmark, pictures):
    method = Radon()
    method.describe(pictures[:2])  # compile
    benchmark.pedantic(method.describe, (pictures,), rounds=5)
    benchmark.extra_info.update(what="`radon`, 128 at once", count=len(pictures), unit="an image")


@pytest.mark.benchmark(group="Radon 173 x 180 of 250 x 250 images")
def test_radon_scikit_image_one(benchmark, pictures):
    v, u = np.mgrid[:250, :250] - 125
    picture = np.where(u**2 + v**2 <= 120**2, pictures[0], 0).astype(float)
    benchmark(radon, picture, theta=np.arange(0, 180, 2.0), circle=True)
    benchmark.extra_info.update(peer="`skimage.transform.radon`")


@pytest.mark.benchmark(group="one query by phase correlation, 173 x 180 each place")
@pytest.mark.parametrize("count", PLACES)
@pytest.mark.parametrize("distance", [PocBand(), Poc()], ids=["poc_band", "poc"])
def test_phase_correlation(benchmark, places, distance, count):
    index = distance.prepare(places[:count])
    queries = places[:64] if isinstance(distance, PocBand) else places[:2]
    benchmark.pedantic(distance.match, (queries, index), rounds=3 if count < PLACES[-1] else 2)
    name = "`poc_band`" if isinstance(distance, PocBand) else "`poc`"
    benchmark.extra_info.update(what=name, size=count, of="places", count=len(queries), unit="a query")


@pytest.mark.benchmark(group="one query by phase correlation, 173 x 180 each place")
@pytest.mark.parametrize("count", PLACES)
def test_phase_correlation_scikit_image(benchmark, places, count):
    """A loop over some of the places."""
    query, some = places.place[0], places.place[: PLACES[0]]

    def loop():
        return [phase_cross_correlation(place, query)[1] for place in some]

    benchmark.pedantic(loop, rounds=2)
    name = "a loop of `phase_cross_correlation`, by that of 318 places"
    benchmark.extra_info.update(peer=name, size=count, of="places", count=len(some) / count)


CAMERAS = {
    "mirror": THESIS_HALF,
    "sphere_512": EquirectangularCamera(512, 256, 180, True),
    "sphere_2048": EquirectangularCamera(2048, 1024, 180, True),
    "cylinder": CylindricalCamera(512, 128, 180, True, -38, 38),
}


@pytest.mark.benchmark(group="views of 16 images")
@pytest.mark.parametrize("view", ["mirror", "panorama", "sphere"])
@pytest.mark.parametrize("camera", CAMERAS)
def test_views(benchmark, camera, view):
    model = CAMERAS[camera]
    images = np.random.default_rng(2).integers(0, 256, (16, model.height, model.width), np.uint8)
    view_of(images[:1], model, view, False)  # the maps are made once
    benchmark.pedantic(view_of, (images, model, view, False), rounds=5)
    why = "each is a `cv2.remap`, which stands beside `reproject`"
    benchmark.extra_info.update(count=len(images), unit="an image", no_peer=why)
