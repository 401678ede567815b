"""The conformance check of distances."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab.api import Signatures
from omnilab.testing.common import check_common, expect, smooth_noise


def check_distance(distance: Any, signatures: Signatures | None = None, equivariant: bool = True) -> None:
    """Shapes, finite, deterministic, chunks agree, a place is nearest to itself, rotations as they should be.

    `signatures` are places that the distance is made for, where it is not for any; not `equivariant` if a rotation of the
    camera does not shift their last axis.
    """
    distance = check_common("distance", distance)
    places = signatures or Signatures(smooth_noise(np.random.default_rng(5), (12, 24, 36)).astype(np.float32))
    index = distance.prepare(places)
    match = distance.match(places, index)
    count = len(places)
    expect(match.distance.shape == (count, count), f"distances have shape {match.distance.shape}, not (Q, P)")
    expect(bool(np.isfinite(match.distance).all()), "distances hold NaN or infinity")
    itself = match.distance.argmin(axis=1)
    expect(bool((itself == np.arange(count)).all()), "a place is not the nearest to itself")
    again = distance.match(places[:5], index)  # in single precision, a distance near 0 is rounding (see `Euclidean`)
    expect(bool(np.allclose(again.distance, match.distance[:5], rtol=1e-4, atol=1e-3 * match.distance.max())),
            "a part of the queries gives other distances than all of them")  # fmt: skip
    blank = distance.match(Signatures(np.zeros_like(places.place)), index)
    expect(bool(np.isfinite(blank.distance).all()), "signatures of zeros give NaN or infinity")
    if match.rotation_rad is not None and equivariant:
        _check_rotation(distance, places, index)


def _check_rotation(distance: Any, places: Signatures, index: Any) -> None:
    samples = places.place.shape[-1]
    for shift in (0, 1, samples // 3, samples - 1):
        rotated = Signatures(
            np.roll(places.place, -shift, axis=-1)
        )  # the camera rotated to the left by `shift` samples
        rotation = distance.match(rotated, index).rotation_rad.diagonal()
        error = np.angle(np.exp(1j * (rotation - 2 * np.pi * shift / samples)))
        expect(bool((np.abs(error) < np.pi / samples).all()),
                f"a turn by {shift} of {samples} samples is answered with {np.rad2deg(rotation)} degrees")  # fmt: skip
        expect(bool((rotation >= -np.pi).all() and (rotation < np.pi).all()), "rotations leave [-pi, pi)")
