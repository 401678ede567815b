"""The conformance check of descriptors."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Bytes, Floats, Signatures, is_cached
from omnilab.runner.boundaries import quarter_shifted, quarter_turned
from omnilab.testing.common import expect, is_same, smooth_images
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule


def check_descriptor(descriptor: Any) -> None:
    """Shape, type, finite, deterministic, batch equals one by one, rotation as declared, defined on black, pickles."""
    conform(DescriptorTrial(descriptor))


class DescriptorTrial(Trial):
    """A descriptor and six smooth images, on which it is trained where it must be."""

    kind = "descriptor"

    @cached_property
    def images(self) -> Bytes:
        return smooth_images(self.given.view, self.given.color)

    @cached_property
    def describing(self) -> Any:
        """The component, trained."""
        return self.component.fit(self.images) if isinstance(self.given, api.Trainable) else self.component

    @cached_property
    def first(self) -> Signatures:
        found: Signatures = self.describing.describe(self.images)
        return found

    def work(self) -> Work:
        plain = self.given.fit(self.images) if isinstance(self.given, api.Trainable) else self.given
        return Work(lambda: plain.describe(self.images), len(self.images), "image")

    @rule("restored from its state, it is what was trained")
    def restored(self) -> None:
        if not isinstance(self.given, api.Trainable):
            raise CannotCheckError("it is not trained")
        restored = self.component.restore(self.describing.state())
        expect(is_same(restored.describe(self.images), self.first, 0),
                "restored from its state, what was trained gives other signatures; hold all that was trained in `state`")  # fmt: skip

    @rule("describes each image by a row of finite float32 numbers, and leaves the images as they are")
    def rows(self) -> None:
        expect(len(self.first) == len(self.images), f"six images are {len(self.first)} signatures")

    @rule("describes the same images the same way each time")
    def deterministic(self) -> None:
        expect(
            is_same(self.first, self.describing.describe(self.images), 0),
            "the same images give other signatures the second time; seed what is drawn by the settings, and keep no state",
        )

    @rule("describes a batch as its images one by one")
    def one_by_one(self) -> None:
        single = [self.describing.describe(self.images[i : i + 1]).place for i in range(len(self.images))]
        expect(
            is_same(Signatures(self.first.place), Signatures(np.concatenate(single)), 1e-5),
            "a batch gives other signatures than its images one by one; let nothing of an image enter another's signature",
        )

    @rule("describes an image bit for bit the same in any batch, as the cache counts on")
    def same_bits(self) -> None:
        if isinstance(self.given, api.Trainable) or not is_cached(self.given):
            raise CannotCheckError("its signatures are not kept: it is trained, or says `cached = False`")
        for chosen in (slice(0, 1), slice(1, None), slice(0, None, 2)):
            some, same = self.describing.describe(np.ascontiguousarray(self.images[chosen])), self.first[chosen]
            alike = some.heading is None or same.heading is None or np.array_equal(some.heading, same.heading)
            expect(alike and np.array_equal(some.place, same.place),
                    "a part of a batch gives other signatures than the whole, in the last bits; describe image by image, or"
                    " say `cached = False`")  # fmt: skip

    @rule("returns arrays that it does not write into later")
    def own_arrays(self) -> None:
        plain = self.given.fit(self.images) if isinstance(self.given, api.Trainable) else self.given
        found = plain.describe(self.images.copy())
        before = found.place.copy()
        plain.describe(self.images[::-1].copy())
        expect(
            np.array_equal(found.place, before),
            "what it returned changes when it describes other images; make a new array each time instead of one buffer",
        )

    @rule("describes black images by finite numbers")
    def black(self) -> None:
        self.describing.describe(np.zeros_like(self.images))  # the boundary looks at the numbers

    @rule("does under a rotation of the camera what it declares")
    def rotation(self) -> None:
        """A quarter turn of the camera moves pixels exactly, so what it does to signatures is known exactly."""
        declared, before = self.given.rotation, self.first
        if declared == "none" and before.heading is None:
            raise CannotCheckError("rotation='none' promises nothing")
        after = self.describing.describe(quarter_turned(self.images, self.given.view))
        if declared != "none":
            expected = _quarter(before.place) if declared == "equivariant" else before.place
            expect(
                is_same(Signatures(expected), Signatures(after.place), 1e-3),
                f"declares rotation={declared!r}, but a quarter turn to the left does something else; declare"
                f" {self._instead(after.place)}",
            )
        if before.heading is not None:
            expect(
                is_same(Signatures(_quarter(before.heading)), Signatures(after.heading), 1e-3),
                "a quarter turn to the left does not shift the last axis of `heading` by a quarter; let it have a sample"
                " for each angle, counter-clockwise",
            )

    def _instead(self, after: Floats) -> str:
        """What a quarter turn shows it to be."""
        before = self.first.place
        if is_same(Signatures(before), Signatures(after), 1e-3):
            return "'invariant'"
        if before.shape[-1] % 4 == 0 and is_same(Signatures(_quarter(before)), Signatures(after), 1e-3):
            return "'equivariant'"
        return "'none'"


def _quarter(values: Floats) -> Floats:
    """What a quarter turn to the left makes of an axis that shifts."""
    samples = values.shape[-1]
    expect(samples % 4 == 0, f"{samples} angles hold no quarter turn; check a descriptor with a multiple of 4")
    return quarter_shifted(values)
