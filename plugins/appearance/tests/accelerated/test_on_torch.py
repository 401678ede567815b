"""Components on a device of torch beside their own on the CPU, on torch's device that is the processor."""

from __future__ import annotations

import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Signatures
from omnilab.errors import DataError
from omnilab_appearance import (
    Cityblock,
    Cosine,
    Euclidean,
    FourierSignature,
    Gist,
    Hog,
    Pearson,
    Poc,
    PocBand,
    Radon,
)
from omnilab_appearance.descriptors.hog import BlockNorm

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'omnilab-appearance[gpu]'")

from omnilab_appearance.accelerated import on_device
from omnilab_appearance.accelerated.implementations import ON_TORCH
from omnilab_appearance.accelerated.torch_device import open_device

DEVICE = open_device("torch:cpu")
SIGNATURE = 1e-5  # how far a signature may be off, of its length; docs/gpu.md
PHASE = 1e-3  # of headings that are phases: those of weak coefficients are less sure, on the CPU as well
DISTANCE = 1e-5  # of the greatest distance of vectors, of 1 for those with a limit
ROTATION_RAD = 1e-4
SEEDS = st.integers(0, 2**32 - 1)
DESCRIPTORS = [
    FourierSignature(rows=12, magnitudes=5, phases=7), FourierSignature(rows=32, color=True), Hog(rows=12, cells=4),
    Hog(rows=32, bins=5, norm=BlockNorm.l2_hys), Hog(rows=3, cells=2, color=True), Gist(rows=12, blocks=4),
    Gist(rows=9, orientations=3, frequency=0.1, blocks=2, color=True), Radon(offsets=23, angles=12),
    Radon(offsets=17, angles=7, color=True), Radon(offsets=47, angles=20),
]  # fmt: skip
DISTANCES = [Cityblock(), Euclidean(), Cosine(), Pearson(), PocBand(), PocBand(angle_band=3, offset_band=2), Poc()]


@pytest.fixture(scope="module", autouse=True)
def _small_blocks():
    """What fills a block up is described, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on_device, "BLOCK", 4)
        yield


def named(component) -> str:
    return str(component)[:60]


def pictures(seed: int, count: int, square: bool, color: bool, smooth: float) -> np.ndarray:
    """Noise, more or less smooth, some rows of which are all of one grey level: where a robot or the sky is."""
    rng = np.random.default_rng(seed)
    found = rng.integers(0, 256, (count, 40, 40 if square else 64, *([3] if color else [])), dtype=np.uint8)
    if smooth:
        found = np.stack([cv2.GaussianBlur(image, (0, 0), smooth) for image in found])
    found[:, :7] = rng.integers(0, 256)
    return found


def assert_alike(found: np.ndarray | None, expected: np.ndarray | None, off: float) -> None:
    """Image by image, by what is off of a signature's length."""
    assert (found is None) == (expected is None)
    if found is None or expected is None:
        return
    assert (found.shape, found.dtype, found.flags.c_contiguous) == (expected.shape, expected.dtype, True)
    apart, length = (np.linalg.norm(a.reshape(len(a), -1).astype(float), axis=1) for a in (found - expected, expected))
    assert (apart <= off * length).all(), (apart / length).max()


@pytest.mark.parametrize("descriptor", DESCRIPTORS, ids=named)
@settings(max_examples=8)
@given(seed=SEEDS, smooth=st.sampled_from([0.0, 1.5]), count=st.integers(1, 3))
def test_signatures_are_those_of_the_cpu(descriptor, seed, smooth, count):
    images = pictures(seed, count, descriptor.view == "mirror", descriptor.color, smooth)
    there, here = DEVICE.accelerated(descriptor).describe(images), descriptor.describe(images)
    assert_alike(there.place, here.place, SIGNATURE)
    assert_alike(there.heading, here.heading, PHASE if isinstance(descriptor, FourierSignature) else SIGNATURE)


@pytest.mark.parametrize("descriptor", DESCRIPTORS, ids=named)
def test_what_an_image_is_described_as_depends_on_no_other_image(descriptor):
    """Bit for bit: the cache keeps signatures image by image."""
    images = pictures(3, on_device.BLOCK + 5, descriptor.view == "mirror", descriptor.color, 0)
    there = DEVICE.accelerated(descriptor)
    found = there.describe(images)
    for i in (0, 7, on_device.BLOCK + 4):
        alone = there.describe(images[i : i + 1])
        np.testing.assert_array_equal(alone.place[0], found.place[i])
        if found.heading is not None:
            np.testing.assert_array_equal(alone.heading[0], found.heading[i])


def signatures(seed: int, count: int, heading: bool) -> Signatures:
    """Places of a random walk: neighbours are alike."""
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(count, 9, 14)).cumsum(axis=0).astype(np.float32)
    return Signatures(place, rng.normal(size=(count, 3, 16)).astype(np.float32) if heading else None)


@pytest.mark.parametrize("distance", DISTANCES, ids=named)
@settings(max_examples=12)
@given(seed=SEEDS, heading=st.booleans(), queries=st.integers(1, 4), places=st.integers(1, 9))
def test_distances_and_rotations_are_those_of_the_cpu(distance, seed, heading, queries, places):
    known, asked = signatures(seed, places, heading), signatures(seed + 1, queries, heading)
    on_torch = DEVICE.accelerated(distance)
    there, here = on_torch.match(asked, on_torch.prepare(known)), distance.match(asked, distance.prepare(known))
    assert (there.distance.dtype, there.distance.shape) == (np.float32, (queries, places))
    least = 1.0 if isinstance(distance, Cosine | Pearson | Poc | PocBand) else float(here.distance.max())
    np.testing.assert_allclose(there.distance, here.distance, rtol=0, atol=DISTANCE * least)
    assert (there.rotation_rad is None) == (here.rotation_rad is None)
    if here.rotation_rad is not None:
        apart = np.angle(np.exp(1j * (there.rotation_rad - here.rotation_rad)))
        assert (np.abs(apart) < ROTATION_RAD).all()


@pytest.mark.parametrize("distance", DISTANCES, ids=named)
def test_blocks_of_bounded_memory_are_put_together(distance, monkeypatch):
    known, asked = signatures(0, 23, True), signatures(1, 5, True)
    on_torch = DEVICE.accelerated(distance)
    whole = on_torch.match(asked, on_torch.prepare(known))
    for module in ("comparing", "describing"):
        monkeypatch.setattr(f"omnilab_appearance.accelerated.{module}.HELD", 4 * 126 * 2)
    parts = on_torch.match(asked, on_torch.prepare(known))
    np.testing.assert_allclose(parts.distance, whole.distance, rtol=0, atol=DISTANCE * whole.distance.max())
    np.testing.assert_allclose(parts.rotation_rad, whole.rotation_rad, atol=ROTATION_RAD)


def test_a_radon_transform_by_a_few_directions_at_a_time_is_the_same(monkeypatch):
    images, there = pictures(5, 2, True, False, 0), DEVICE.accelerated(Radon(offsets=23, angles=12))
    whole = there.describe(images).place
    monkeypatch.setattr("omnilab_appearance.accelerated.describing.HELD", 16 * 23**2 * 4)
    np.testing.assert_array_equal(there.describe(images).place, whole)


@pytest.mark.parametrize("distance", [PocBand(), Poc(), Cosine(), Pearson(), Euclidean(), Cityblock()], ids=named)
def test_signatures_without_any_content_are_as_far_as_on_the_cpu(distance):
    """Where nothing is found, nothing is made up: zeros have no direction and no phase."""
    known, on_torch = Signatures(np.zeros((2, 9, 14), np.float32), np.zeros((2, 3, 16), np.float32)), None
    asked, on_torch = signatures(1, 2, True), DEVICE.accelerated(distance)
    there, here = on_torch.match(asked, on_torch.prepare(known)), distance.match(asked, distance.prepare(known))
    np.testing.assert_allclose(there.distance, here.distance, rtol=1e-6)
    np.testing.assert_array_equal(there.rotation_rad, here.rotation_rad)


@pytest.mark.parametrize(
    ("descriptor", "shape", "words"),
    [
        (FourierSignature(rows=50), (1, 40, 64), "rows=50 are more than the 40 rows"),
        (Hog(rows=50), (1, 40, 64), "rows=50 are more than the 40 rows"),
        (Gist(rows=50), (1, 40, 64), "rows=50 are more than the 40 rows"),
        (FourierSignature(rows=8), (1, 40, 20), "a panorama of 20 columns has 11 frequencies, not 16 and 17"),
        (Hog(rows=8), (1, 40, 2), "pictures of (8, 2) pixels have no gradients"),
        (Radon(), (1, 40, 64), "are not square"),
    ],
)
def test_images_that_do_not_fit_are_refused_in_the_same_words(descriptor, shape, words):
    for one in (descriptor, DEVICE.accelerated(descriptor)):
        with pytest.raises(DataError) as refusal:
            one.describe(np.zeros(shape, np.uint8))
        assert words in str(refusal.value)


@pytest.mark.parametrize("cls", ON_TORCH, ids=lambda cls: cls.__name__)
def test_one_on_the_device_has_the_settings_of_its_component_and_can_be_sent(cls):
    there = pickle.loads(pickle.dumps(DEVICE.accelerated(cls())))
    assert isinstance(there, cls)
    assert vars(there) == vars(cls()) | {"device": DEVICE.device}


def test_too_little_memory_there_is_said_as_of_a_machine():
    with pytest.raises(MemoryError, match=r"on the device: CUDA out of memory$"), on_device.memory_as_usual():
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20 GiB")


def test_what_the_runner_gives_read_only_is_no_obstacle():
    images = pictures(0, 2, False, False, 0)
    images.flags.writeable = False
    there = DEVICE.accelerated(Hog(rows=20)).describe(images)
    there.place.flags.writeable = False
    distance = DEVICE.accelerated(Pearson())
    assert distance.match(there, distance.prepare(there)).distance.argmin(axis=1).tolist() == [0, 1]
