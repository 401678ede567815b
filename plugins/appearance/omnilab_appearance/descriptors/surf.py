"""SURF features of the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures
from omnilab.errors import ConfigError
from omnilab_appearance.common.image_ops import channels_of
from omnilab_appearance.common.local_features import packed
from omnilab_appearance.descriptors.sift import check_count


@dataclass
class Surf:
    """SURF features of the mirror image (Bay et al., 2008), by mahotas: OpenCV's wheels leave SURF out.

    The strongest `features` of each image: (N, features, 3 + 64), as `omnilab_appearance.common.local_features` lays them out.
    mahotas finds about as many features as OpenCV does, but places them less precisely.
    """

    features: int = 300  # at most so many of each image
    threshold: float = 0.1  # detection threshold

    view: ClassVar[str] = "mirror"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"
    default_distance: ClassVar[str] = "features_turned"

    def __post_init__(self) -> None:
        check_count(self.features)
        if not self.threshold > 0:
            raise ConfigError(f"threshold={self.threshold:g} lets everything pass; give a number above 0, such as 0.1")

    def describe(self, images: Bytes) -> Signatures:
        """Features of mirror images (N, S, S)."""
        from mahotas.features import surf

        def features_of(image: Bytes) -> tuple[Floats, Floats]:
            found = surf.surf(image, threshold=self.threshold, max_points=self.features)
            found = found[np.argsort(-found[:, 3], kind="stable")]  # y, x, scale, score, laplacian, angle, vector
            return found[:, 1::-1], found[:, 6:]

        views = channels_of(images, self.color)
        return packed([features_of(image) for image in views], self.features, 64, views.shape[1:3])
