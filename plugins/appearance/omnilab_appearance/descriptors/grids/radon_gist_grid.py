"""Gist of the Radon transform in a grid of blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.block_norm import normalized_grid
from omnilab_appearance.common.gabor import energies
from omnilab_appearance.common.image_ops import band_means, channels_of, side_by_side
from omnilab_appearance.descriptors.radon import Radon, one_side, without_means


@dataclass
class RadonGistGrid:
    """Gist of the Radon transform that bears noise, occlusion, blur and light: what `gist_grid` is to `gist`.

    Where `radon_gist` (Berenguer, thesis, 4.2.2) has bands of offsets over all angles, blocks here are `width` angles
    wide, the energies of all orientations in a block are brought to unit length but for `floor` times the mean length, and
    are compared over rotations. The mean of each offset over all angles is left out first: it is what a constant added
    to the image changes, and no rotation does. Of the offsets one side is enough, and of the pyramid its first level.
    `place` is (N, orientations x blocks, angles / spacing): a rotation shifts its last axis.
    """

    orientations: int = setting(8, at_least=1, at_most=1024)  # evenly over 180 degrees
    blocks: int = setting(16, at_least=1, at_most=4096)  # bands of offsets, from the middle outwards
    width: int = setting(4, at_least=1, at_most=4096)  # angles of a block
    spacing: int = setting(2, at_least=1, at_most=4096)  # angles from one block to the next
    frequency: float = setting(0.2, at_least=0.01, at_most=0.5)  # of the filters, in cycles per sample
    floor: float = setting(0.05, at_least=0, at_most=1000)  # of the lengths that blocks are divided by, in mean lengths
    offsets: int = setting(64, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(128, at_least=4, at_most=4096, multiple_of=2)  # of the Radon transform
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "circular_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures (N, orientations x blocks, angles / spacing) of square mirror images (N, S, S[, 3])."""
        transforms = without_means(Radon(self.offsets, self.angles).describe(channels_of(images, self.color)).place)
        side = one_side(energies(transforms, self.orientations, self.frequency))
        blocks = normalized_grid(band_means(side, self.blocks), self.width, self.spacing, self.floor)
        return side_by_side(Signatures(blocks), self.color)
