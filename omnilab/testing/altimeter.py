"""The conformance check of altimeters."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab.cameras import HyperbolicMirror
from omnilab.testing.common import SIDE, check_common, expect, smooth_images


def check_altimeter(altimeter: Any) -> None:
    """Shapes, deterministic, one reference for many tests, batch equals one by one, defined on black, pickles."""
    altimeter = check_common("altimeter", altimeter)
    images, camera = smooth_images("mirror", color=False), HyperbolicMirror(SIDE)
    first = altimeter.relative(images[:1], images, camera)
    for name in ("value", "confidence", "rotation_rad"):
        expect(getattr(first, name).shape == (len(images),), f"{name} has not one number for each of the tests")
    expect(first.unit != "", "heights have no unit; say 'm', or what they count")
    known = np.isfinite(first.value)
    expect(bool((first.confidence[known] >= 0).all() and (first.confidence <= 1).all()), "confidences leave [0, 1]")
    for curve, values in first.curves.items():
        expect(len(values) == len(images), f"the curve '{curve}' has not one row for each of the tests")
    each = altimeter.relative(np.repeat(images[:1], len(images), axis=0), images, camera).value
    expect(
        np.array_equal(each, first.value, equal_nan=True),
        "a reference for each test gives other heights than one for all",
    )
    single = [altimeter.relative(images[:1], images[i : i + 1], camera).value for i in range(len(images))]
    expect(bool(np.allclose(np.concatenate(single), first.value, equal_nan=True)),
            "a batch gives other heights than its images one by one")  # fmt: skip
    black = altimeter.relative(np.zeros_like(images[:1]), np.zeros_like(images), camera)
    expect(bool((black.confidence == 0).all()), "black images have a confidence above 0")
