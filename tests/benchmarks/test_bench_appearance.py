"""Radon transform and phase correlation beside what a user would write today.

pytest tests/benchmarks --benchmark-enable -n 0
"""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.registration import phase_cross_correlation
from skimage.transform import radon

from omnilab.api import Signatures
from omnilab_appearance import Poc, PocBand, Radon

PLACES = 1271  # the thesis's 8 x 6 m at 0.2 m


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(0)
    noise = np.stack([gaussian_filter(rng.standard_normal((250, 250)), 2) for _ in range(128)])
    return np.clip(127 + 50 * noise / noise.std(), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def places():
    rng = np.random.default_rng(1)
    return Signatures(gaussian_filter(rng.standard_normal((PLACES, 173, 180)).astype(np.float32), (0, 3, 3)))


@pytest.mark.benchmark(group="Radon 173 x 180 of 250 x 250 images")
def test_radon_batch_of_128(benchmark, pictures):
    method = Radon()
    method.describe(pictures[:2])  # compile
    benchmark(method.describe, pictures)
    benchmark.extra_info["images"] = len(pictures)


@pytest.mark.benchmark(group="Radon 173 x 180 of 250 x 250 images")
def test_radon_scikit_image_one(benchmark, pictures):
    v, u = np.mgrid[:250, :250] - 125
    picture = np.where(u**2 + v**2 <= 120**2, pictures[0], 0).astype(float)
    benchmark(radon, picture, theta=np.arange(0, 180, 2.0), circle=True)
    benchmark.extra_info["images"] = 1


@pytest.mark.benchmark(group=f"one query against {PLACES} places")
@pytest.mark.parametrize("distance", [PocBand(), Poc()], ids=["poc_band", "poc"])
def test_phase_correlation(benchmark, places, distance):
    index = distance.prepare(places)
    queries = places[:64] if isinstance(distance, PocBand) else places[:2]
    benchmark.pedantic(distance.match, (queries, index), rounds=5, warmup_rounds=1)
    benchmark.extra_info["queries"] = len(queries)


@pytest.mark.benchmark(group=f"one query against {PLACES} places")
def test_phase_correlation_scikit_image(benchmark, places):
    """A loop over a tenth of the places."""
    query, some = places.place[0], places.place[: PLACES // 10]

    def loop():
        return [phase_cross_correlation(place, query)[1] for place in some]

    benchmark.pedantic(loop, rounds=2)
    benchmark.extra_info["queries"] = len(some) / PLACES
