"""SURF features of the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab_appearance.common.image_ops import channels_of
from omnilab_appearance.common.local_features import packed


@dataclass
class Surf:
    """SURF features of the mirror image (Bay et al., 2008), by mahotas: OpenCV's wheels leave SURF out.

    The strongest `features` of each image: (N, features, 3 + 64), as `omnilab_appearance.common.local_features` lays them out.
    mahotas finds about as many features as OpenCV does, but places them less precisely.
    """

    features: int = setting(300, at_least=1, at_most=10_000)  # at most so many of each image
    threshold: float = setting(0.1, above=0)  # detection threshold

    view: ClassVar[str] = "mirror"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"
    default_distance: ClassVar[str] = "features_turned"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Features of mirror images (N, S, S)."""
        from mahotas.features import surf

        def features_of(image: Bytes) -> tuple[Floats, Floats]:
            found = surf.surf(image, threshold=self.threshold, max_points=self.features)
            found = found[np.argsort(-found[:, 3], kind="stable")]  # y, x, scale, score, laplacian, angle, vector
            return found[:, 1::-1], found[:, 6:]

        views = channels_of(images, self.color)
        return packed([features_of(image) for image in views], self.features, 64, views.shape[1:3])
