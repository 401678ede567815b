"""Gaussian blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, check_settings, setting
from omnilab.image import goes_around, wrapped

REACH = 4  # standard deviations at which the kernel ends


@dataclass
class Blur:
    """Convolution with a Gaussian; beyond the frame the image goes on as its mirror image, a panorama at its other end."""

    sigma_px: float = setting(2.0, at_least=0, at_most=1000)  # standard deviation in pixels; 0: none

    def __post_init__(self) -> None:
        check_settings(self)

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:
        """The images, blurred."""
        import cv2

        del rngs  # nothing is drawn
        reach = int(np.ceil(REACH * self.sigma_px))
        if reach == 0:
            return images.copy()
        size, blurred = (2 * reach + 1, 2 * reach + 1), np.empty_like(images)
        margin = reach * goes_around(camera)
        for image, soft in zip(images, blurred, strict=True):
            wide = wrapped(image[None], camera, reach)[0].astype(np.float32)
            found = np.rint(cv2.GaussianBlur(wide, size, self.sigma_px))
            soft[...] = found[:, margin : found.shape[1] - margin]
        return blurred
