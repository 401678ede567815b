"""Gist of the Radon transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_appearance.common.gabor import energies, halved
from omnilab_appearance.common.image_ops import channels_of, side_by_side
from omnilab_appearance.descriptors.gist import block_means
from omnilab_appearance.descriptors.radon import Radon


@dataclass
class RadonGist:
    """Gist of the Radon transform: means of Gabor responses in bands of offsets (Berenguer, thesis, 4.2.2).

    A pyramid of `levels` Radon transforms, `orientations` filters on each, and the mean of each response in `blocks`
    bands of offsets over all angles: (N, levels, orientations, blocks), invariant under rotation.
    """

    blocks: int = setting(16, at_least=1, at_most=4096)  # b, bands of offsets
    orientations: int = setting(4, at_least=1, at_most=1024)  # of the Gabor filters, evenly over 180 degrees
    levels: int = setting(2, at_least=1, at_most=16)  # n, of the Gaussian pyramid
    frequency: float = setting(0.2, at_least=0.01, at_most=0.5)  # of the filters, in cycles per sample
    offsets: int = setting(173, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(180, at_least=4, at_most=4096)  # of the Radon transform
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "euclidean"

    def __post_init__(self) -> None:
        check_settings(self)
        smallest = min(self.offsets, self.angles) >> max(0, self.levels - 1)
        if self.levels < 1 or smallest < 8:
            raise ConfigError(
                f"levels={self.levels} of a transform of {self.offsets} x {self.angles} leave {smallest} samples;"
                " give fewer levels or a larger transform"
            )

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of square mirror images (N, S, S[, 3])."""
        transforms = Radon(self.offsets, self.angles).describe(channels_of(images, self.color)).place / images.shape[1]
        parts = []
        for level in range(self.levels):
            transforms = halved(transforms) if level else transforms
            parts.append(block_means(energies(transforms, self.orientations, self.frequency), self.blocks))
        return side_by_side(Signatures(np.stack(parts, 1)), self.color)
