"""A disturbance: pixels that are dead or burnt."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from omnilab import (
    Bytes,
    Camera,
    Disturbance,
    check_settings,
    setting,
)


@dataclass
class MyDisturbance:
    """Salt and pepper: a share of the pixels turns black or white, half of them each."""

    share: float = setting(0.05, at_least=0, at_most=1)  # of all pixels; 0: none

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(
        self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]
    ) -> Bytes:
        """New images like the given ones (N, H, W[, 3]); image i draws from `rngs[i]`."""
        spoiled = images.copy()  # what is given can only be read
        for image, rng in zip(spoiled, rngs, strict=True):
            drawn = rng.random(image.shape[:2])
            image[drawn < self.share / 2] = 0
            image[drawn >= 1 - self.share / 2] = 255
        return spoiled


# a type checker compares it with the contract:
_: type[Disturbance] = MyDisturbance
