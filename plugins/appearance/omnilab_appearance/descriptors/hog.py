"""Histograms of oriented gradients of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.block_norm import BlockNorm, blocks_normalized
from omnilab_appearance.common.image_ops import bands, channels_of, columns_around, side_by_side, with_rows


@dataclass
class Hog:
    """HOG of the panorama: histograms of gradient directions, weighted by their magnitude (Payá et al., 2016, 3.1.3).

    `place`: horizontal cells of full width (N, cells, bins), which are invariant under rotation. `heading`:
    vertical cells of full height, which overlap (N, bins, columns / spacing): a rotation shifts their last axis. Values
    are grey levels per pixel, averaged over the cell; directions count modulo 180 degrees, each to its bin alone.

    `norm` is the third step of Berenguer's thesis (2.1.4): all cells of a block, `block` cells below one another, are
    normalised by one measure of the block's contrast. The thesis does not say which; these are the four of
    Dalal & Triggs (2005). Blocks do not overlap, so that the size stays cells x bins, as the thesis has it. The heading
    part, whose correlation is normalised, stays as it is.
    """

    cells: int = setting(16, at_least=1, at_most=4096)  # k4, horizontal ones, for the place
    bins: int = setting(8, at_least=1, at_most=1024)  # b, of each histogram, over 180 degrees
    width: int = setting(32, at_least=1, at_most=8192)  # l1, columns of a vertical cell, for the heading
    spacing: int = setting(8, at_least=1, at_most=8192)  # d1, columns from one vertical cell to the next
    rows: int = setting(128, at_least=3, at_most=8192)  # the panorama is averaged to so many
    color: bool = False  # each channel of RGB for itself
    norm: BlockNorm = BlockNorm.none  # of blocks of cells: none, l1, l1_sqrt, l2 or l2_hys
    block: int = setting(2, at_least=1, at_most=4096)  # cells of a block; must divide the cells

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "pearson"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of panoramas (N, H, W[, 3])."""
        rows, columns = self._gradient_sums(channels_of(images, self.color))
        heading = columns_around(columns / self.rows, self.width, self.spacing)
        place = blocks_normalized(cell_means(rows, self.cells), self.block, self.norm)
        return side_by_side(Signatures(place, heading), self.color)

    def _gradient_sums(self, images: Bytes) -> tuple[Floats, Floats]:
        """`gradient_sums` of panoramas (N, H, W)."""
        return gradient_sums(with_rows(images, self.rows), self.bins)


def gradient_sums(images: Floats, bins: int) -> tuple[Floats, Floats]:
    """Gradient magnitude by direction: row means (N, H, bins) and column sums (N, bins, W) of images (N, H, W).

    Gradients are central differences; the last axis wraps around, the first and the last row have no vertical part.
    """
    from omnilab_appearance.common.kernels import gradient_histograms, gradient_histograms_of_one

    check_has_gradients(*images.shape[1:])
    count, height, width = images.shape
    rows, columns = np.zeros((count, height, bins), np.float32), np.zeros((count, width, bins), np.float32)
    pixels = np.ascontiguousarray(images, np.float32)
    if count == 1:  # threads would wait for each other for longer than one image takes
        gradient_histograms_of_one(pixels[0], rows[0], columns[0])
    else:
        gradient_histograms(pixels, rows, columns)
    return rows / width, columns.transpose(0, 2, 1)


def check_has_gradients(rows: int, columns: int) -> None:
    """DataError for images that are too small for central differences."""
    if min(rows, columns) < 3:
        raise DataError(f"pictures of {(rows, columns)} pixels have no gradients; give at least 3 x 3")


def cell_means(rows: Floats, cells: int) -> Floats:
    """Means (N, cells, bins) over horizontal cells of row means (N, H, bins)."""
    return np.stack([rows[:, band].mean(axis=1) for band in bands(cells, rows.shape[1])], 1).astype(np.float32)
