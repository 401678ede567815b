"""What a run cannot see of a component in passing, tried once: on the first image that a descriptor is given."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Signatures

log = logging.getLogger("omnilab")

SAME, TURNED = 1e-4, 0.05  # of a signature's length: how far one may be off that should be the same, or turned
SLOW_S = 0.2  # for an image, below which nobody waits
UNIT_S = 0.02  # that a unit of time is measured for
SLOW = 150  # Fourier transforms of the image; built-in ones take as long as 13 of them in the median; spherical_sift comes near on noise


class SpotCheck:
    """Warns, once, of a descriptor that describes its first image otherwise alone, rotated or again, or takes very long.

    The image is described three times more, by a component of its own, so that no result of the run is another.
    """

    def __init__(self, descriptor: Any, title: str, name: str = "NAME") -> None:
        self.descriptor, self.title, self.name, self.done = descriptor, title, name, False

    def __call__(self, found: Signatures, images: Bytes) -> None:
        """Look at what a batch of images was described as."""
        if self.done or not len(images):
            return
        self.done = True
        try:
            wrong = self._wrong(found[:1], images[:1])
        except Exception as error:  # noqa: BLE001  it described this image a moment ago
            wrong = [f"raises {type(error).__name__} when the first image is described again, alone or turned: {error}"]
        for sentence in wrong:
            log.warning("%s %s; omnilab check descriptor=%s says more", self.title, sentence, self.name)

    def _wrong(self, among_others: Signatures, image: Bytes) -> list[str]:
        held, seconds = _timed(self.descriptor.describe, image)
        alone = held.place.copy()
        turned = self.descriptor.describe(quarter_turned(image, self.descriptor.view)).place.copy()
        is_buffer = not np.array_equal(held.place, alone)
        again, seconds_again = _timed(self.descriptor.describe, image)
        wrong = []
        if _differs(again.place, alone, SAME):
            wrong.append("describes the same image otherwise the second time; have it keep no state")
        elif _differs(among_others.place, alone, SAME):
            wrong.append("describes an image otherwise alone than in a batch; let no image enter another's signature")
        elif self._is_known(image, turned) and _differs(turned, self._expected(alone), TURNED):
            declared = self.descriptor.rotation
            wrong.append(f"declares rotation={declared!r}, but a quarter turn does something else; correct that")
        if is_buffer:
            wrong.append(
                "returns one buffer for every call, which has to be copied; have it make a new array each time"
            )
        if (least := min(seconds, seconds_again)) > max(SLOW_S, SLOW * (unit := _transform_s(image))):
            wrong.append(
                f"takes {least:.2g} s for an image, as long as {least / unit:.0f} Fourier transforms of it (built-in"
                " ones: 13 in the median); use array operations in place of loops over pixels"
            )
        return wrong

    def _is_known(self, image: Bytes, turned: Floats) -> bool:
        """Whether it is known what a quarter turn should do."""
        view, rotation = self.descriptor.view, self.descriptor.rotation
        rows, columns = image.shape[1:3]
        whole = rows == columns if view == "mirror" else columns % 4 == 0
        return bool(whole) and (rotation == "invariant" or (rotation == "equivariant" and turned.shape[-1] % 4 == 0))

    def _expected(self, place: Floats) -> Floats:
        if self.descriptor.rotation == "invariant":
            return place
        return quarter_shifted(place)


def quarter_turned(images: Bytes, view: str) -> Bytes:
    """Images (N, H, W[, 3]) of a view after a quarter turn of the camera to the left."""
    if view == "mirror":
        return np.ascontiguousarray(np.rot90(images, k=-1, axes=(1, 2)))
    return np.roll(images, -images.shape[2] // 4, axis=2)


def quarter_shifted(values: Floats) -> Floats:
    """What a quarter turn to the left makes of a last axis that shifts, of a multiple of four samples."""
    return np.roll(values, -values.shape[-1] // 4, axis=-1)


def _differs(one: Floats, other: Floats, off: float) -> bool:
    if one.shape != other.shape:
        return True
    return bool(np.linalg.norm(one - other) > off * max(np.linalg.norm(one), np.linalg.norm(other)))


def _timed(describe: Callable[[Bytes], Signatures], image: Bytes) -> tuple[Signatures, float]:
    start = time.perf_counter()
    found = describe(image)
    return found, time.perf_counter() - start


def _transform_s(image: Bytes) -> float:
    """How long a Fourier transform of an image takes here: what other times are measured by."""
    taken: list[float] = []
    while len(taken) < 3 or sum(taken) < UNIT_S:  # the least of many is the same on a busy machine
        start = time.perf_counter()
        np.fft.fft2(image[0].astype(float), axes=(0, 1))
        taken.append(time.perf_counter() - start)
    return min(taken)
