"""Images averaged down, blurred and continued along one axis: each sample out is a weighted sum of a few samples."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omnilab.api import Array, Floats, Ints
from omnilab_appearance.accelerated.on_device import OnDevice, Tensor


class Taps(NamedTuple):
    """Which samples along an axis are summed, with which weights."""

    samples: Ints  # (out, T)
    weights: Floats  # (out, T) float32; 0 where fewer than T count


@lru_cache(maxsize=16)
def resized_taps(length: int, size: int) -> Taps:
    """The taps of OpenCV's `resize` along one axis: area average, or linear to a greater size.

    They are read off the resized identity, so that they are OpenCV's own.
    """
    import cv2

    how = cv2.INTER_AREA if length >= size else cv2.INTER_LINEAR
    weights = np.asarray(cv2.resize(np.eye(length, dtype=np.float32), (length, size), interpolation=how))
    first = (weights != 0).argmax(axis=1)
    width = int((weights != 0).sum(axis=1).max())
    index = np.minimum(first[:, None] + np.arange(width), length - 1)
    counted = first[:, None] + np.arange(width) < length
    return Taps(index, np.where(counted, np.take_along_axis(weights, index, axis=1), 0).astype(np.float32))


@lru_cache(maxsize=16)
def halved_taps(length: int, wraps: bool) -> Taps:
    """The taps of `halved`: OpenCV's Gaussian of 7 samples, every second one; the axis wraps or is reflected."""
    import cv2

    window = np.arange(0, length, 2)[:, None] + np.arange(7)  # of the axis with 3 samples more at either end
    around = np.arange(-3, length + 3) % length if wraps else reflected(length, 3)
    gaussian = cv2.getGaussianKernel(7, 1.0, cv2.CV_32F).ravel()
    return Taps(around[window], np.broadcast_to(gaussian, window.shape).astype(np.float32))


def reflected(length: int, margin: int) -> Ints:
    """The samples of an axis with so many more at either end, continued by reflection."""
    return np.asarray(np.pad(np.arange(length), margin, mode="symmetric"))


def along(values: Tensor, taps: Taps, axis: int, on: OnDevice) -> Tensor:
    """Weighted sums along an axis, one tap after the other: equal samples give equal sums, whatever is beside them."""
    first = taps.weights.flat[0]
    if (taps.weights == first).all():  # as OpenCV: whole numbers are summed exactly
        return first * sum(values.index_select(axis, on.there(samples)) for samples in taps.samples.T)
    total: Tensor = 0
    for samples, weight in zip(taps.samples.T, taps.weights.T, strict=True):
        total = total + on.there(_to_axis(weight, axis)) * values.index_select(axis, on.there(samples))
    return total


def _to_axis(weight: Array, axis: int) -> Array:
    """Weights (out,) that multiply along an axis of (N, H, W)."""
    return weight.reshape([-1 if k == axis else 1 for k in range(3)])
