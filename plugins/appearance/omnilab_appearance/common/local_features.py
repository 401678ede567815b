"""Local features packed into signatures of one shape."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Signatures
from omnilab.errors import DataError
from omnilab_appearance.common.vectors import unit


class Detector(Enum):
    """The detector and descriptor of local features."""

    surf = "surf"
    sift = "sift"  # OpenCV's
    fast_sift = "fast_sift"  # compiled here
    plain_sift = "plain_sift"  # the same of the picture as it is, which is not doubled first


class LocalFeatures(NamedTuple):
    """F local features of each of N images, padded with zeros where an image has fewer."""

    xy: Floats  # (N, F, 2): pixels right of and above the image's centre
    valid: Floats  # (N, F): 1, or 0 of padding
    vectors: Floats  # (N, F, D), of unit length


def packed(found: list[tuple[Floats, Floats]], count: int, dimensions: int, shape: tuple[int, int]) -> Signatures:
    """Signatures (N, count, 3 + D) from each image's positions (K, 2) = (u, v) and vectors (K, D), strongest first.

    A row is a feature: x and y in pixels right of and above the centre of the image (H, W), 1, and its unit vector; the
    rows of padding are zero.
    """
    place = np.zeros((len(found), count, 3 + dimensions), np.float32)
    for rows, (uv, vectors) in zip(place, found, strict=True):
        k = min(count, len(uv))
        rows[:k, 0] = uv[:k, 0] - (shape[1] - 1) / 2
        rows[:k, 1] = (shape[0] - 1) / 2 - uv[:k, 1]
        rows[:k, 2] = 1
        rows[:k, 3:] = unit(vectors[:k])
    return Signatures(place)


def unpacked(signatures: Signatures) -> LocalFeatures:
    """The features in signatures (N, F, 3 + D); DataError for signatures of another layout."""
    place = signatures.place
    if place.ndim != 3 or place.shape[2] < 4 or not np.isin(place[:, :, 2], (0, 1)).all():
        raise DataError(
            f"signatures of shape {place.shape[1:]} hold no local features; choose descriptor=sift or surf, or another distance"
        )
    return LocalFeatures(place[:, :, :2], place[:, :, 2], np.ascontiguousarray(place[:, :, 3:]))
