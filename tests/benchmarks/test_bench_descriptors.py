"""Description times beside what a user would write today with numpy and scikit-image, on the same panoramas."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage.feature import hog
from skimage.filters import gabor

from omnilab_appearance import (
    FourierPhase,
    FourierSignature,
    Gist,
    GistGrid,
    Hog,
    HogGrid,
    RadonGist,
    RadonGistGrid,
    RadonHog,
    RadonHogGrid,
    RingKey,
    RotationalPca,
    Sift,
    Surf,
    TinyImage,
)

IMAGES = 64
RNG = np.random.default_rng(0)
PANORAMAS = RNG.integers(0, 256, (IMAGES, 128, 512), dtype=np.uint8)
MIRRORS = RNG.integers(0, 256, (IMAGES, 250, 250), dtype=np.uint8)


ALONE = "a comparison of one another; those that libraries have stand beside them"


def each(benchmark, count, peer=""):
    benchmark.extra_info.update(count=count, unit="an image", peer=peer, no_peer=ALONE)


@pytest.mark.benchmark(group="Fourier signature, 128 rows, 16 magnitudes")
def test_bench_fourier_signature(benchmark):
    descriptor = FourierSignature(rows=128)
    benchmark.pedantic(descriptor.describe, (PANORAMAS,), rounds=5, warmup_rounds=1)
    each(benchmark, IMAGES)


@pytest.mark.benchmark(group="Fourier signature, 128 rows, 16 magnitudes")
def test_bench_fourier_signature_by_numpy(benchmark):
    """Magnitudes and phases, row by row."""

    def describe(image):
        spectra = [np.fft.fft(row) for row in image]
        return np.array([np.abs(s[:16]) for s in spectra]), np.array([np.angle(s[1:17]) for s in spectra])

    magnitudes, _ = benchmark.pedantic(describe, (PANORAMAS[0],), rounds=20, warmup_rounds=1)
    np.testing.assert_allclose(
        FourierSignature(rows=128).describe(PANORAMAS[:1]).place[0], magnitudes, rtol=1e-4, atol=0.05
    )
    each(benchmark, 1, "`numpy.fft`, row by row")


@pytest.mark.benchmark(group="HOG, 16 cells of full width, 8 bins")
def test_bench_hog(benchmark):
    benchmark.pedantic(Hog().describe, (PANORAMAS,), rounds=5, warmup_rounds=1)
    each(benchmark, IMAGES)


@pytest.mark.benchmark(group="HOG, 16 cells of full width, 8 bins")
def test_bench_hog_by_scikit_image(benchmark):
    found = benchmark.pedantic(
        hog,
        (PANORAMAS[0], 8, (8, 512), (1, 1)),
        {"feature_vector": False, "block_norm": "L1"},
        rounds=10,
        warmup_rounds=1,
    )
    ours = Hog().describe(PANORAMAS[:1]).place[0]
    ours = ours / ours.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(ours, found[:, 0, 0, 0], atol=0.01)  # it does not wrap around, and normalises each cell
    each(benchmark, 1, "`skimage.feature.hog`")


@pytest.mark.benchmark(group="gist, 128 rows, 2 levels, 8 orientations, 16 blocks")
def test_bench_gist(benchmark):
    descriptor = Gist(rows=128, orientations=8)
    benchmark.pedantic(descriptor.describe, (PANORAMAS,), rounds=3, warmup_rounds=1)
    each(benchmark, IMAGES)


@pytest.mark.benchmark(group="gist, 128 rows, 2 levels, 8 orientations, 16 blocks")
def test_bench_gist_by_scikit_image(benchmark):
    from skimage.transform import pyramid_reduce

    def describe(image):
        place = []
        for picture in (image.astype(float), pyramid_reduce(image.astype(float), sigma=1, preserve_range=True)):
            for m in range(8):
                response = np.hypot(*gabor(picture, 0.2, np.pi * m / 8, mode="wrap"))
                place.append([block.mean() for block in np.array_split(response, 16)])
        return np.array(place)

    found = benchmark.pedantic(describe, (PANORAMAS[0],), rounds=2)
    ours = Gist(rows=128, orientations=8).describe(PANORAMAS[:1]).place[0]
    # it continues the top of the panorama with its bottom, so the outer blocks differ
    np.testing.assert_allclose(ours[0, :, 1:-1], found[:8, 1:-1], rtol=0.02)
    each(benchmark, 1, "`skimage.filters.gabor`")


@pytest.mark.benchmark(group="local features of 16 mirror images of 250 x 250")
@pytest.mark.parametrize("descriptor", [Sift(), Surf()], ids=lambda d: type(d).__name__)
def test_bench_local_features(benchmark, descriptor):
    benchmark.pedantic(descriptor.describe, (MIRRORS[:16],), rounds=2, warmup_rounds=1)
    each(benchmark, 16)


@pytest.mark.benchmark(group="local features of 16 mirror images of 250 x 250")
def test_bench_local_features_by_opencv(benchmark):
    """SURF is not in OpenCV's wheels."""
    sift = cv2.SIFT_create()
    benchmark.pedantic(
        lambda: [sift.detectAndCompute(image, None) for image in MIRRORS[:16]], rounds=2, warmup_rounds=1
    )
    each(benchmark, 16, "`cv2.SIFT`")


@pytest.mark.benchmark(group="description of 64 images, each descriptor as it comes")
@pytest.mark.parametrize(
    "descriptor", [RadonGist(), RadonGistGrid(), RadonHog(), RadonHogGrid()], ids=lambda d: type(d).__name__
)
def test_bench_of_mirror_images(benchmark, descriptor):
    benchmark.pedantic(descriptor.describe, (MIRRORS,), rounds=2, warmup_rounds=1)
    each(benchmark, IMAGES)


@pytest.mark.benchmark(group="description of 64 images, each descriptor as it comes")
@pytest.mark.parametrize(
    "descriptor",
    [RingKey(), TinyImage(), FourierSignature(), FourierPhase(), Hog(), HogGrid(), Gist(), GistGrid()],
    ids=lambda d: type(d).__name__,
)
def test_bench_of_panoramas(benchmark, descriptor):
    benchmark.pedantic(descriptor.describe, (PANORAMAS,), rounds=3, warmup_rounds=1)
    each(benchmark, IMAGES)


@pytest.mark.benchmark(group="rotational PCA, 64 rotations of 200 panoramas of 64 x 256")
def test_bench_rotational_pca(benchmark):
    panoramas = RNG.integers(0, 256, (200, 64, 256), dtype=np.uint8)
    benchmark.extra_info["no_peer"] = (
        "all rotations at once, by Fourier blocks: libraries' PCA would take 64 times the images"
    )
    space = benchmark.pedantic(RotationalPca(rows=64, rotations=64).fit, (panoramas,), rounds=2)
    assert space.describe(panoramas[:2]).place.shape == (2, 50)
