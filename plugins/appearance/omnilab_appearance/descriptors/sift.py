"""SIFT features of the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab_appearance.common.image_ops import channels_of
from omnilab_appearance.common.local_features import packed


@dataclass
class Sift:
    """SIFT features of the mirror image (Lowe, 2004; the baseline of the Radon transform in Berenguer's thesis, 4.6.5).

    The strongest `features` of each image: (N, features, 3 + 128), as `omnilab_appearance.common.local_features` lays them out.
    """

    features: int = setting(300, at_least=1, at_most=10_000)  # at most so many of each image
    contrast: float = setting(0.04, above=0)  # detection threshold

    view: ClassVar[str] = "mirror"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"
    default_distance: ClassVar[str] = "features_turned"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Features of mirror images (N, S, S)."""
        import cv2

        detector = cv2.SIFT_create(nfeatures=self.features, contrastThreshold=self.contrast)  # type: ignore[attr-defined]

        def features_of(image: Bytes) -> tuple[Floats, Floats]:
            points, vectors = detector.detectAndCompute(image, None)
            if not points:
                return np.zeros((0, 2)), np.zeros((0, 128))
            order = np.argsort([-point.response for point in points], kind="stable")
            return np.array([point.pt for point in points])[order], vectors[order]

        views = channels_of(images, self.color)
        return packed([features_of(image) for image in views], self.features, 128, views.shape[1:3])
