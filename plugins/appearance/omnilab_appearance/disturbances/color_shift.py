"""Colour shift: another white balance, or light of another colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, check_settings, setting
from omnilab.errors import DataError


@dataclass
class ColorShift:
    """A factor on each channel of RGB images, rounded and clipped. Grey images have no colour to shift: DataError."""

    gains: list[float] = setting([1.2, 1.0, 0.8], at_least=0, count=3)  # of red, green and blue

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:  # noqa: ARG002  nothing is drawn
        """The images with their colours shifted."""
        if images.ndim != 4:
            raise DataError(
                "a color_shift needs RGB images, and these are grey; give sensor.color=true, or disturbance=light"
            )
        levels = np.arange(256)[:, None] * np.array(self.gains)
        table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
        return np.asarray(table[images, np.arange(3)])
