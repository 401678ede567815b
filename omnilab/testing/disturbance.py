"""The conformance check of disturbances."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Bytes
from omnilab.cameras import HyperbolicMirror
from omnilab.errors import DataError
from omnilab.testing.common import SIDE, expect, generators, smooth_images
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule


def check_disturbance(disturbance: Any, harmless: Any = None, color: bool | None = None) -> None:
    """Shape, type, deterministic by seed, batch equals one by one, input left alone, pickles.

    On RGB images with `color`, on grey ones without; where it is not given, on grey ones unless the disturbance refuses
    them with a DataError. `harmless` is the same component, set so that it must change nothing, where there is one.
    """
    conform(DisturbanceTrial(disturbance, harmless, color))


class DisturbanceTrial(Trial):
    """A disturbance and six smooth images of a mirror."""

    kind = "disturbance"

    def __init__(self, disturbance: Any, harmless: Any = None, color: bool | None = None) -> None:
        super().__init__(disturbance)
        self.harmless, self.color = harmless, color
        self.camera = HyperbolicMirror(SIDE)

    @cached_property
    def images(self) -> Bytes:
        if self.color is not None:
            return smooth_images("mirror", self.color)
        grey = smooth_images("mirror", color=False)
        try:
            self.given.apply(grey[:1].copy(), self.camera, generators()[:1])
        except DataError:
            return smooth_images("mirror", color=True)
        except Exception:  # noqa: BLE001  the rules say it
            return grey
        return grey

    @cached_property
    def first(self) -> Bytes:
        return np.asarray(self.component.apply(self.images, self.camera, generators()))

    def work(self) -> Work:
        return Work(lambda: self.given.apply(self.images, self.camera, generators()), len(self.images), "image")

    @rule("makes new images of the same shape and type, and leaves the given ones as they are")
    def images_like_them(self) -> None:
        expect(self.first.shape == self.images.shape, f"images of {self.images.shape} become {self.first.shape}")

    @rule("draws from the generators it is given, and from nothing else")
    def deterministic(self) -> None:
        again = self.component.apply(self.images, self.camera, generators())
        expect(np.array_equal(self.first, again),
                "the same seeds give other images the second time; draw from `rngs[i]`, and from no other generator")  # fmt: skip

    @rule("disturbs a batch as its images one by one")
    def one_by_one(self) -> None:
        single = [self.component.apply(self.images[i : i + 1], self.camera, [g]) for i, g in enumerate(generators())]
        expect(np.array_equal(self.first, np.concatenate(single)),
                "a batch gives other images than its images one by one; draw for image i from `rngs[i]` alone")  # fmt: skip

    @rule("changes nothing when it is set so")
    def without_effect(self) -> None:
        if self.harmless is None:
            raise CannotCheckError("which settings do nothing is not known; give check_disturbance a `harmless` one")
        kept = self.harmless.apply(self.images, self.camera, generators())
        expect(np.array_equal(kept, self.images), "set so that it changes nothing, it changes the images")
