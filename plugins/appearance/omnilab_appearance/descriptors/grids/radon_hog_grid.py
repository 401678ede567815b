"""HOG of the Radon transform in a grid of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.block_norm import normalized_grid
from omnilab_appearance.common.image_ops import band_edges, channels_of, side_by_side, smoothed
from omnilab_appearance.descriptors.radon import Radon, one_side, without_means


@dataclass
class RadonHogGrid:
    """HOG of the Radon transform that bears noise, occlusion, blur and light: what `hog_grid` is to `hog`.

    Where `radon_hog` (Berenguer, thesis, 6.2) has bands of offsets over all angles, cells here are `width` angles wide
    (after Dalal & Triggs, 2005), hold signed gradients of the smoothed transform, are brought to unit length but for
    `floor` times the mean length, and are compared over rotations. The mean of each offset over all angles is left out
    first: it is what a constant added to the image changes, and no rotation does. Of the offsets one side is enough.
    `place` is (N, bins x cells, angles / spacing): a rotation shifts its last axis.
    """

    cells: int = setting(16, at_least=1, at_most=4096)  # bands of offsets, from the middle outwards
    bins: int = setting(8, at_least=1, at_most=1024)  # of each histogram, over 360 degrees
    width: int = setting(8, at_least=1, at_most=4096)  # angles of a cell
    spacing: int = setting(4, at_least=1, at_most=4096)  # angles from one cell to the next
    smoothing: float = setting(1.0, at_least=0, at_most=100)  # standard deviation of the Gaussian, in samples; 0: none
    floor: float = setting(0.05, at_least=0, at_most=1000)  # of the lengths that cells are divided by, in mean lengths
    offsets: int = setting(128, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(256, at_least=4, at_most=4096, multiple_of=2)  # of the Radon transform
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "circular_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures (N, bins x cells, angles / spacing) of square mirror images (N, S, S[, 3])."""
        from omnilab_appearance.common.kernels import gradient_cells

        transforms = without_means(Radon(self.offsets, self.angles).describe(channels_of(images, self.color)).place)
        side = one_side(smoothed(transforms, self.smoothing))
        angles = gradient_cells(side, self.bins, 2 * np.pi, band_edges(self.cells, side.shape[1]))
        cells = normalized_grid(angles, self.width, self.spacing, self.floor)
        return side_by_side(Signatures(cells), self.color)
