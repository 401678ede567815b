"""Occlusion by rectangles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from omnilab.api import Bytes, Camera, check_settings, setting


@dataclass
class Occlusion:
    """Rectangles filled with the mean of all the image's pixels (Berenguer, thesis, 4.6.4.2: 0.1, 0.2, 0.3).

    The image is cut into as many equal strips as there are rectangles, upright or lying ones by chance, and each strip
    gets one rectangle of random proportions and place: they do not overlap. What they cover together differs from
    `fraction` of the image's pixels by less than one row or column, the share beyond the image circle included; of a sphere,
    whose pixels are smaller near the poles, they hide that share of the pixels.
    """

    fraction: float = setting(0.1, at_least=0, at_most=1)  # of the image's area, covered by all rectangles together
    rectangles: int = setting(2, at_least=1, at_most=10_000)  # how many

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:  # noqa: ARG002  the frame is covered, not the circle
        """The images with their rectangles."""
        occluded = images.copy()
        for image, rng in zip(occluded, rngs, strict=True):
            mean = np.rint(image.mean(axis=(0, 1)))
            strips = image if rng.random() < 0.5 else image.swapaxes(0, 1)
            for rows, columns in self._rectangles(strips.shape, rng):
                strips[rows, columns] = mean
        return occluded

    def _rectangles(self, shape: tuple[int, ...], rng: np.random.Generator) -> Iterator[tuple[slice, slice]]:
        """Rows and columns of one rectangle in each strip of columns, from left to right."""
        height, covered = shape[0], 0
        edges = np.linspace(0, shape[1], self.rectangles + 1).astype(int)
        for left, right in pairwise(edges):
            area = self.fraction * height * right - covered  # what rounding left of the strips before comes in here
            widest = int(right - left)
            if widest == 0 or area < 0.5:
                continue
            narrowest = min(widest, int(np.ceil(area / height)))
            w = int(rng.integers(narrowest, widest + 1))
            h = min(height, round(area / w))
            top, start = int(rng.integers(height - h + 1)), int(rng.integers(left, right - w + 1))
            covered += h * w
            yield slice(top, top + h), slice(start, start + w)
