"""The conformance check of altimeters."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Heights
from omnilab.cameras import HyperbolicMirror
from omnilab.testing.common import SIDE, expect, smooth_images
from omnilab.testing.rules import Trial, Work, conform, rule


def check_altimeter(altimeter: Any) -> None:
    """Shapes, deterministic, one reference for many tests, batch equals one by one, defined on black, pickles."""
    conform(AltimeterTrial(altimeter))


class AltimeterTrial(Trial):
    """An altimeter and six smooth images, the first of which is the reference of all."""

    kind = "altimeter"

    def __init__(self, altimeter: Any) -> None:
        super().__init__(altimeter)
        self.images, self.camera = smooth_images("mirror", color=False), HyperbolicMirror(SIDE)

    @cached_property
    def first(self) -> Heights:
        heights: Heights = self.component.relative(self.images[:1], self.images, self.camera)
        return heights

    def work(self) -> Work:
        return Work(lambda: self.given.relative(self.images[:1], self.images, self.camera), len(self.images), "image")

    @rule("gives a height, a confidence in [0, 1] and a rotation of each image, in a unit")
    def heights(self) -> None:
        first, count = self.first, len(self.images)
        for name in ("value", "confidence", "rotation_rad"):
            expect(getattr(first, name).shape == (count,), f"{name} has not one number for each of the tests")
        expect(first.unit != "", "heights have no unit; say 'm', or what they count")
        known = np.isfinite(first.value)
        expect(bool((first.confidence[known] >= 0).all() and (first.confidence <= 1).all()), "confidences leave [0, 1]")
        for curve, values in first.curves.items():
            expect(len(values) == count, f"the curve '{curve}' has not one row for each of the tests")

    @rule("takes one reference for all images, or one for each")
    def references(self) -> None:
        each = self.component.relative(np.repeat(self.images[:1], len(self.images), axis=0), self.images, self.camera)
        expect(np.array_equal(each.value, self.first.value, equal_nan=True),
                "a reference for each test gives other heights than one for all")  # fmt: skip

    @rule("compares a batch as its images one by one")
    def one_by_one(self) -> None:
        single = [
            self.component.relative(self.images[:1], self.images[i : i + 1], self.camera).value
            for i in range(len(self.images))
        ]
        expect(bool(np.allclose(np.concatenate(single), self.first.value, equal_nan=True)),
                "a batch gives other heights than its images one by one; let no image enter another's height")  # fmt: skip

    @rule("has no confidence in black images")
    def black(self) -> None:
        dark = self.component.relative(np.zeros_like(self.images[:1]), np.zeros_like(self.images), self.camera)
        expect(
            bool((dark.confidence == 0).all()), "black images have a confidence above 0; where nothing is seen, say 0"
        )
