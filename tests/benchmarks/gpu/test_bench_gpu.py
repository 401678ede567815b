"""Description and search on a GPU beside the CPU: uv run --group gpu pytest tests/benchmarks/gpu --benchmark-enable -n 0 -m slow"""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Signatures
from omnilab.errors import ConfigError
from omnilab_appearance import Cityblock, Cosine, Euclidean, FourierSignature, Gist, Hog, Pearson, Poc, PocBand, Radon
from omnilab_appearance.accelerated.torch_device import open_device

IMAGES, PLACES, QUERIES = 512, 4800, 64
RNG = np.random.default_rng(0)
DESCRIPTORS = [FourierSignature(), Hog(), Gist(), Radon()]
DISTANCES = [Cityblock(), Euclidean(), Cosine(), Pearson(), PocBand(), Poc()]
NO_PEER = "the same component on the CPU and on the GPU, in one group"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def gpu():
    """The GPU, opened."""
    try:
        return open_device("cuda")
    except ConfigError as error:
        pytest.skip(str(error))


@pytest.fixture(params=["cpu", "cuda"])
def on(request, gpu):
    """`on(component)`: the component itself, or the one on the GPU."""
    return gpu.accelerated if request.param == "cuda" else lambda component: component


def named(component) -> str:
    return type(component).__name__


@pytest.mark.parametrize("descriptor", DESCRIPTORS, ids=named)
def test_bench_describe(benchmark, measured, on, gpu, descriptor):
    benchmark.group = f"{named(descriptor)} of {IMAGES} images"
    shape = (250, 250) if descriptor.view == "mirror" else (128, 512)
    images = RNG.integers(0, 256, (IMAGES, *shape), dtype=np.uint8)
    found = benchmark.pedantic(on(descriptor).describe, (images,), rounds=5, warmup_rounds=1)
    alike(found.place[:32], descriptor.describe(images[:32]).place)
    benchmark.extra_info.update(count=IMAGES, unit="an image", no_peer=NO_PEER, device=gpu.computed_on)


@pytest.mark.parametrize("distance", DISTANCES, ids=named)
def test_bench_search(benchmark, measured, on, gpu, distance):
    """Signatures of the size of a Radon transform for `poc` and `poc_band`, of 1024 numbers for the others."""
    benchmark.group = f"{named(distance)}, {QUERIES} queries, {PLACES} places"
    shape = (173, 180) if isinstance(distance, Poc | PocBand) else (64, 16)
    places = Signatures(RNG.random((PLACES, *shape), dtype=np.float32))
    compared = on(distance)
    index = compared.prepare(places)
    found = benchmark.pedantic(compared.match, (places[:QUERIES], index), rounds=3, warmup_rounds=1)
    few = places[:100]
    alike(found.distance[:2, 2:100], distance.match(places[:2], distance.prepare(few)).distance[:, 2:])
    benchmark.extra_info.update(count=QUERIES, unit="a query", no_peer=NO_PEER, device=gpu.computed_on)


def alike(found, expected) -> None:
    """What is fast is right, too."""
    assert np.linalg.norm(found - expected) <= 1e-4 * np.linalg.norm(expected)
