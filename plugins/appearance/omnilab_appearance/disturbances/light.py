"""Change of illumination: gain and gamma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, check_settings, setting


@dataclass
class Light:
    """Grey level g becomes 255 * gain * (g / 255)^gamma, rounded and clipped: brightness, then contrast of the darks."""

    gain: float = setting(0.5, at_least=0)  # factor on all levels; 1: none
    gamma: float = setting(1.0, above=0)  # exponent: above 1 the darks get darker, below 1 brighter

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:  # noqa: ARG002  nothing is drawn
        """The images in this light."""
        level = 255 * self.gain * (np.arange(256) / 255) ** self.gamma
        return np.clip(np.rint(level), 0, 255).astype(np.uint8)[images]
