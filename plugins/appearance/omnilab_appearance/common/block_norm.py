"""Normalisation of histograms within blocks of cells."""

from __future__ import annotations

from enum import Enum

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab_appearance.common.image_ops import columns_around

EPSILON = 1e-5  # as in scikit-image
CLIPPED = 0.2  # of L2-Hys (Lowe, 2004)


class BlockNorm(Enum):
    """How the values of a block v are normalised (Dalal & Triggs, 2005, 6.4)."""

    none = "none"  # not at all
    l1 = "l1"  # v / |v|_1
    l1_sqrt = "l1_sqrt"  # sqrt(v / |v|_1)
    l2 = "l2"  # v / |v|_2
    l2_hys = "l2_hys"  # L2, clipped at 0.2, and L2 again


def blocks_normalized(cells: Floats, size: int, norm: BlockNorm) -> Floats:
    """Histograms (N, cells, bins), each block of `size` cells after one another normalised as a whole, (N, cells, bins)."""
    if norm is BlockNorm.none:
        return cells
    count, total, bins = cells.shape
    if total % size:
        raise DataError(f"blocks of {size} cells do not divide {total} cells; give a divisor")
    blocks = cells.reshape(count, total // size, size * bins).astype(np.float64)
    return np.asarray(_normalized(blocks, norm).reshape(cells.shape), np.float32)


def _normalized(blocks: Floats, norm: BlockNorm) -> Floats:
    """Vectors along the last axis, normalised; those of zeros stay zero."""
    if norm in {BlockNorm.l1, BlockNorm.l1_sqrt}:
        shares = blocks / (np.abs(blocks).sum(-1, keepdims=True) + EPSILON)
        return np.asarray(shares if norm is BlockNorm.l1 else np.sqrt(shares))
    unit = _unit(blocks)
    return unit if norm is BlockNorm.l2 else _unit(np.minimum(unit, CLIPPED))


def _unit(blocks: Floats) -> Floats:
    return np.asarray(blocks / np.sqrt((blocks**2).sum(-1, keepdims=True) + EPSILON**2))


def normalized_grid(values: Floats, width: int, spacing: int, floor: float) -> Floats:
    """Histograms (N, bins, rows, W), averaged over windows of columns and each normalised: (N, bins x rows, W / spacing)."""
    cells = cells_normalized(columns_around(values, width, spacing), floor)
    return cells.reshape(len(cells), -1, cells.shape[-1])


def cells_normalized(cells: Floats, floor: float) -> Floats:
    """Histograms (N, bins, ...), each cell's brought to unit length but for `floor` times the image's mean length.

    The floor keeps cells without texture, whose histogram is noise, from counting as much as the others.
    """
    length = np.sqrt((cells.astype(np.float64) ** 2).sum(axis=1, keepdims=True))
    mean = length.mean(axis=tuple(range(1, cells.ndim)), keepdims=True)
    return np.asarray(cells / (length + floor * mean + EPSILON), np.float32)
