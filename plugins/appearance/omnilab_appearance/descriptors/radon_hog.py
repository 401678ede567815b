"""HOG of the Radon transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_appearance.common.image_ops import channels_of, side_by_side
from omnilab_appearance.descriptors.hog import cell_means, gradient_sums
from omnilab_appearance.descriptors.radon import Radon


@dataclass
class RadonHog:
    """HOG of the Radon transform, in bands of offsets over all angles (Berenguer, thesis, 6.2).

    Histograms of gradient directions, weighted by their magnitude: (N, cells, bins) numbers, invariant under
    rotation. The thesis finds loop closures with them.
    """

    cells: int = setting(16, at_least=1, at_most=4096)  # bands of offsets
    bins: int = setting(8, at_least=1, at_most=1024)  # of each histogram, over 180 degrees
    offsets: int = setting(173, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(180, at_least=4, at_most=4096)  # of the Radon transform
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "cosine"

    def __post_init__(self) -> None:
        check_settings(self)
        if not (1 <= self.cells <= self.offsets and self.bins >= 1):
            raise ConfigError(
                f"cells={self.cells}, bins={self.bins} hold no histogram; give 1 to {self.offsets} cells and 1 bin or more"
            )

    def describe(self, images: Bytes) -> Signatures:
        """Signatures (N, cells, bins) of square mirror images (N, S, S[, 3])."""
        transforms = Radon(self.offsets, self.angles).describe(channels_of(images, self.color)).place
        rows, _ = gradient_sums(transforms / images.shape[1], self.bins)
        return side_by_side(Signatures(cell_means(rows, self.cells)), self.color)
