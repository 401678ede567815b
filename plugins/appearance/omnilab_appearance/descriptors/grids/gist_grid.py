"""Gist in a grid of blocks around the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab_appearance.common.block_norm import normalized_grid
from omnilab_appearance.common.gabor import energies, halved
from omnilab_appearance.common.image_ops import band_means, channels_of, resized, side_by_side


@dataclass
class GistGrid:
    """Gist that bears noise, occlusion, blur and light: blocks of rows and columns, normalised, compared over rotations.

    Where `gist` has horizontal blocks of full width, blocks here are `width` columns wide (Oliva & Torralba, 2001, have
    a grid, too), so that a covered part of the view changes the blocks around it alone. The panorama is smaller than
    that of `gist`: the same filters cover more of it, and see less noise. The energies of all orientations in a
    block are brought to unit length but for `floor` times the mean length. `place` is (N, 2 levels x orientations x
    blocks, columns / spacing): a rotation shifts its last axis.
    """

    orientations: int = setting(8, at_least=1, at_most=1024)  # evenly over 180 degrees
    blocks: int = setting(8, at_least=1, at_most=4096)  # below one another
    width: int = setting(4, at_least=2, at_most=8192, multiple_of=2)  # columns of a block
    spacing: int = setting(2, at_least=2, at_most=8192, multiple_of=2)  # columns from one block to the next
    frequency: float = setting(0.2, at_least=0.01, at_most=0.5)  # of the filters, in cycles per pixel
    floor: float = setting(0.05, at_least=0, at_most=1000)  # of the lengths that blocks are divided by, in mean lengths
    rows: int = setting(32, at_least=4, at_most=8192)  # the panorama is averaged to so many
    columns: int = setting(128, at_least=4, at_most=8192, multiple_of=2)  # the panorama is averaged to so many
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "circular_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures (N, 2 x orientations x blocks, columns / spacing) of panoramas (N, H, W[, 3])."""
        fine = resized(channels_of(images, self.color), self.rows, self.columns)
        fine -= fine.mean(axis=(1, 2), keepdims=True)  # of which a Gabor filter lets some through
        levels = [self._level(fine, 0), self._level(halved(fine), 1)]
        return side_by_side(Signatures(np.concatenate(levels, 1)), self.color)

    def _level(self, panoramas: Floats, level: int) -> Floats:
        """The blocks (N, orientations x blocks, columns / spacing) of one level of the pyramid."""
        found = energies(panoramas, self.orientations, self.frequency)
        rows = band_means(found, self.blocks)
        return normalized_grid(rows, self.width >> level, self.spacing >> level, self.floor)
