"""Gaussian blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, check_settings, setting

REACH = 4  # standard deviations at which the kernel ends


@dataclass
class Blur:
    """Convolution with a Gaussian; beyond the frame the image goes on as its mirror image."""

    sigma_px: float = setting(2.0, at_least=0, at_most=1000)  # standard deviation in pixels; 0: none

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:  # noqa: ARG002  nothing is drawn
        """The images, blurred."""
        import cv2

        blurred = images.copy()
        size = 2 * int(np.ceil(REACH * self.sigma_px)) + 1
        if size > 1:
            for image in blurred:
                image[...] = np.rint(cv2.GaussianBlur(image.astype(np.float32), (size, size), self.sigma_px))
        return blurred
