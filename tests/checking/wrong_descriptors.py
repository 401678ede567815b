"""A right descriptor, and ones that break one promise each: a plugin's file for tests."""

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab import hookimpl
from omnilab.api import Signatures


@dataclass
class Right:
    """Mean grey level of each column."""

    view: ClassVar[str] = "panorama"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "poc"

    def describe(self, images):
        return Signatures(images.mean(axis=1, dtype=np.float32).reshape(len(images), -1, 8).mean(axis=2))


@dataclass
class Wide(Right):
    """Of 64 bits."""

    def describe(self, images):
        return Signatures(super().describe(images).place.astype(float))


@dataclass
class Short(Right):
    """One signature too few."""

    def describe(self, images):
        return Signatures(super().describe(images).place[:-1])


@dataclass
class Centered(Right):
    """Less the mean of the batch."""

    def describe(self, images):
        place = super().describe(images).place
        return Signatures(place - place.mean(axis=0))


@dataclass
class Undefined(Right):
    """Not a number where there is no contrast."""

    def describe(self, images):
        place = super().describe(images).place
        with np.errstate(all="ignore"):
            return Signatures(place / np.where(np.ptp(images, axis=(1, 2)) > 0, 1, 0)[:, None].astype(np.float32))


@dataclass
class Turning(Right):
    """Declared invariant, and is not."""

    rotation: ClassVar[str] = "invariant"


@dataclass
class Writing(Right):
    """Writes into the images."""

    def describe(self, images):
        images[:, 0] = 0
        return super().describe(images)


@dataclass
class Holding(Right):
    """One buffer for every call."""

    def __post_init__(self):
        self._buffer = np.zeros((10_000, 64), np.float32)

    def describe(self, images):
        self._buffer[: len(images)] = super().describe(images).place
        return Signatures(self._buffer[: len(images)])


@dataclass
class Counting(Right):
    """Counts its calls, and adds them."""

    calls: int = 0

    def describe(self, images):
        self.calls += 1
        return Signatures(super().describe(images).place + np.float32(50 * self.calls))


@dataclass
class Slow(Right):
    """Waits."""

    seconds: float = 0.25  # per image

    def describe(self, images):
        time.sleep(self.seconds * len(images))
        return super().describe(images)


@hookimpl
def register_descriptors(register):
    for cls in (Right, Wide, Short, Centered, Undefined, Turning, Writing, Holding, Counting, Slow):
        register(cls.__name__.lower(), cls)
