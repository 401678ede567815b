"""Histograms of oriented gradients in a grid of cells around the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.block_norm import normalized_grid
from omnilab_appearance.common.image_ops import band_edges, channels_of, resized, side_by_side, smoothed


@dataclass
class HogGrid:
    """HOG that bears noise, occlusion, blur and light: cells of rows and columns, normalised, compared over rotations.

    Where `hog` has horizontal cells of full width, whose histograms noise and a covered part of the view change as a whole,
    cells here are `width` columns wide (after Dalal & Triggs, 2005), and a covered one leaves the others as they are.
    Gradients are those of the panorama smoothed by a Gaussian, which takes noise away and is what blur does; they keep
    their sign (`signed`: 360 degrees in place of 180), and each cell's histogram is brought to unit length but for
    `floor` times the mean length. `place` is (N, bins x cells, columns / spacing): a rotation shifts its last axis.
    """

    cells: int = setting(8, at_least=1, at_most=4096)  # below one another
    bins: int = setting(8, at_least=1, at_most=1024)  # of each histogram
    width: int = setting(8, at_least=1, at_most=8192)  # columns of a cell
    spacing: int = setting(4, at_least=1, at_most=8192)  # columns from one cell to the next
    smoothing: float = setting(3.0, at_least=0, at_most=100)  # standard deviation of the Gaussian, in pixels; 0: none
    signed: bool = True  # directions over 360 degrees, not 180
    floor: float = setting(0.05, at_least=0, at_most=1000)  # of the lengths that cells are divided by, in mean lengths
    rows: int = setting(64, at_least=3, at_most=8192)  # the panorama is averaged to so many
    columns: int = setting(256, at_least=3, at_most=8192)  # the panorama is averaged to so many
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "circular_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures (N, bins x cells, columns / spacing) of panoramas (N, H, W[, 3])."""
        from omnilab_appearance.common.kernels import gradient_cells

        edges = band_edges(self.cells, self.rows)
        panoramas = smoothed(resized(channels_of(images, self.color), self.rows, self.columns), self.smoothing)
        turn = 2 * np.pi if self.signed else np.pi
        columns = gradient_cells(np.ascontiguousarray(panoramas, np.float32), self.bins, turn, edges)
        cells = normalized_grid(columns, self.width, self.spacing, self.floor)
        return side_by_side(Signatures(cells), self.color)
