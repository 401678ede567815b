"""The conformance check of disturbances."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab.cameras import HyperbolicMirror
from omnilab.testing.common import SIDE, check_common, expect, generators, smooth_images


def check_disturbance(disturbance: Any, harmless: Any, color: bool = False) -> None:
    """Shape, type, deterministic by seed, batch equals one by one, input left alone, pickles; on RGB with `color`.

    `harmless` is the same component, set so that it must change nothing.
    """
    disturbance = check_common("disturbance", disturbance)
    images, camera = smooth_images("mirror", color), HyperbolicMirror(SIDE)
    first = disturbance.apply(images, camera, generators())
    again = disturbance.apply(images, camera, generators())
    expect(np.array_equal(first, again), "the same seeds give other images the second time")
    single = [disturbance.apply(images[i : i + 1], camera, [rng]) for i, rng in enumerate(generators())]
    expect(np.array_equal(first, np.concatenate(single)), "a batch gives other images than its images one by one")
    kept = harmless.apply(images, camera, generators())
    expect(np.array_equal(kept, images), "set so that it changes nothing, it changes the images")
