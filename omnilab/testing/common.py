"""Test images, random generators and comparisons of the conformance checks."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Signatures
from omnilab.image import PANORAMA_SHAPE
from omnilab.runner.boundaries import check_declared
from omnilab.runner.registry import check_component

SPHERE_SHAPE = (128, 256)
SIDE = 96  # of the pictures that descriptors are tried on


def check_common(kind: str, component: Any) -> None:
    """A dataclass with the Protocol's members, documented, that survives pickling."""
    cls = type(component)
    check_component(kind, cls.__name__.lower(), cls)
    manual = str(cls.__doc__)
    check_declared(kind, component, cls.__name__)
    expect(not manual.startswith(f"{cls.__name__}("), f"{cls.__name__} has no docstring, and that is its manual")
    expect(pickle.loads(pickle.dumps(component)) == component, "does not survive pickling")  # noqa: S301  our own


def smooth_images(view: str, color: bool) -> Bytes:
    """Six smooth random pictures."""
    shape = (6, *{"mirror": (SIDE, SIDE), "sphere": SPHERE_SHAPE}.get(view, PANORAMA_SHAPE))
    rng = np.random.default_rng(11)
    layers = [np.clip(128 + 60 * smooth_noise(rng, shape), 0, 255).astype(np.uint8) for _ in range(3 if color else 1)]
    return np.stack(layers, axis=-1) if color else layers[0]


def generators() -> list[np.random.Generator]:
    """One for each of the pictures."""
    return [np.random.default_rng(seed) for seed in range(6)]


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int, int]) -> Floats:
    """Periodic noise (N, rows, columns) of unit variance whose spectrum falls off like 1 / frequency."""
    spectrum = np.fft.fft2(rng.standard_normal(shape))
    fy, fx = np.fft.fftfreq(shape[1])[:, None], np.fft.fftfreq(shape[2])[None, :]
    spectrum /= np.hypot(fy, fx) + 0.05
    noise = np.fft.ifft2(spectrum).real
    return np.asarray(noise / noise.std(axis=(1, 2), keepdims=True))


def is_same(one: Signatures, other: Signatures, tolerance: float) -> bool:
    scale = float(np.abs(one.place).max()) or 1.0
    return one.place.shape == other.place.shape and bool(
        np.allclose(one.place, other.place, rtol=tolerance, atol=tolerance * scale)
    )


def expect(good: bool, message: str) -> None:
    if not good:
        raise AssertionError(message)
