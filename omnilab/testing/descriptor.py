"""The conformance check of descriptors."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Bytes, Floats, Signatures, is_cached
from omnilab.testing.common import check_common, expect, is_same, smooth_images


def check_descriptor(descriptor: Any) -> None:
    """Shape, type, finite, deterministic, batch equals one by one, rotation as declared, defined on black, pickles."""
    descriptor = check_common("descriptor", descriptor)
    images = smooth_images(descriptor.view, descriptor.color)
    if is_trainable := isinstance(descriptor, api.Trainable):
        trainable, descriptor = descriptor, descriptor.fit(images)
        expect(is_same(trainable.restore(descriptor.state()).describe(images), descriptor.describe(images), 0),
                "restored from its state, what was trained gives other signatures")  # fmt: skip
    first = descriptor.describe(images)
    expect(isinstance(first, Signatures), f"describes images as {type(first).__name__}, not as Signatures")
    for part in (first.place, *([] if first.heading is None else [first.heading])):
        expect(len(part) == len(images), f"describes {len(images)} images as {len(part)} signatures")
        expect(part.dtype == np.float32, f"signatures are {part.dtype}, float32 is expected")
        expect(bool(np.isfinite(part).all()), "signatures hold NaN or infinity")
    expect(is_same(first, descriptor.describe(images), 0), "the same images give other signatures the second time")
    single = [descriptor.describe(images[i : i + 1]) for i in range(len(images))]
    alone = Signatures(np.concatenate([s.place for s in single]))
    expect(is_same(Signatures(first.place), alone, 1e-5), "a batch gives other signatures than its images one by one")
    if not is_trainable and is_cached(descriptor):
        _check_parts(descriptor, images, first)
    black = descriptor.describe(np.zeros_like(images))
    expect(bool(np.isfinite(black.place).all()), "black images give NaN or infinity")
    _check_rotation(descriptor, images, first)


def _check_parts(descriptor: Any, images: Bytes, whole: Signatures) -> None:
    """What the cache counts on: the rest of a batch changes no bit of an image's signature."""
    for chosen in (slice(0, 1), slice(1, None), slice(0, None, 2)):
        some, same = descriptor.describe(np.ascontiguousarray(images[chosen])), whole[chosen]
        alike = some.heading is None or same.heading is None or np.array_equal(some.heading, same.heading)
        expect(alike and np.array_equal(some.place, same.place),
                "a part of a batch gives other signatures than the whole, in the last bits; describe image by image, or"
                " say `cached = False`")  # fmt: skip


def _check_rotation(descriptor: Any, images: Bytes, before: Signatures) -> None:
    """A quarter turn of the camera moves pixels exactly, so what it does to signatures is known exactly."""
    expect(
        descriptor.rotation in {"equivariant", "invariant", "none"},
        f"rotation={descriptor.rotation!r} is none of 'equivariant', 'invariant', 'none'",
    )
    if descriptor.rotation == "none" and before.heading is None:
        return
    if descriptor.view == "mirror":
        rotated = np.rot90(images, k=-1, axes=(1, 2))
    else:
        rotated = np.roll(images, -images.shape[2] // 4, axis=2)
    after = descriptor.describe(np.ascontiguousarray(rotated))
    if descriptor.rotation != "none":
        expected = _quarter(before.place) if descriptor.rotation == "equivariant" else before.place
        expect(
            is_same(Signatures(expected), Signatures(after.place), 1e-3),
            f"declares rotation={descriptor.rotation!r}, but a quarter turn to the left does something else",
        )
    if before.heading is not None:
        expect(
            is_same(Signatures(_quarter(before.heading)), Signatures(after.heading), 1e-3),
            "a quarter turn to the left does not shift the last axis of `heading` by a quarter",
        )


def _quarter(values: Floats) -> Floats:
    """What a quarter turn to the left makes of an axis that shifts."""
    samples = values.shape[-1]
    expect(samples % 4 == 0, f"{samples} angles hold no quarter turn; check a descriptor with a multiple of 4")
    return np.roll(values, -samples // 4, axis=-1)
