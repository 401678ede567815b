"""Gist of the panorama."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab_appearance.common.gabor import energies, halved
from omnilab_appearance.common.image_ops import bands, channels_of, columns_around, side_by_side, with_rows


@dataclass
class Gist:
    """Gist of the panorama: means of Gabor responses at two resolutions (Payá et al., 2016, 3.1.4; Oliva & Torralba).

    `place`: horizontal blocks of full width (N, 2 levels, orientations, blocks), which are invariant under
    rotation. `heading`: vertical blocks of full height, which overlap (N, 2 x orientations, columns / spacing): a
    rotation shifts their last axis.
    """

    orientations: int = setting(16, at_least=1, at_most=1024)  # m, evenly over 180 degrees
    blocks: int = setting(16, at_least=1, at_most=4096)  # k6, horizontal ones, for the place
    width: int = setting(
        32, at_least=2, at_most=8192, multiple_of=2
    )  # l2, columns of a vertical block, for the heading
    spacing: int = setting(
        8, at_least=2, at_most=8192, multiple_of=2
    )  # d2, columns from one vertical block to the next
    frequency: float = setting(0.2, at_least=0.01, at_most=0.5)  # of the filters, in cycles per pixel
    rows: int = setting(64, at_least=2, at_most=8192)  # the panorama is averaged to so many
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "pearson"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of panoramas (N, H, W[, 3])."""
        parts = []
        for level, (rows, columns) in enumerate(self._energy_means(channels_of(images, self.color))):
            heading = columns_around(columns, self.width >> level, self.spacing >> level)
            parts.append((band_means_of_rows(rows, self.blocks), heading))
        place = np.stack([place for place, _ in parts], 1)
        heading = np.concatenate([heading for _, heading in parts], 1)
        return side_by_side(Signatures(place, heading), self.color)

    def _energy_means(self, images: Bytes) -> Iterator[tuple[Floats, Floats]]:
        """Gabor energies of panoramas (N, H, W), level by level: means of the rows (N, M, H) and of the columns (N, M, W)."""
        fine = with_rows(images, self.rows)
        for panoramas in (fine, halved(fine)):
            found = energies(panoramas, self.orientations, self.frequency)
            yield found.mean(axis=3, dtype=np.float64), found.mean(axis=2)


def block_means(found: Floats, blocks: int) -> Floats:
    """Means (N, M, blocks) over the horizontal blocks of responses (N, M, H, W)."""
    return band_means_of_rows(found.mean(axis=3, dtype=np.float64), blocks)


def band_means_of_rows(rows: Floats, blocks: int) -> Floats:
    """Means (N, M, blocks) over horizontal blocks, of the means (N, M, H) of rows."""
    return np.stack([rows[:, :, band].mean(axis=2) for band in bands(blocks, rows.shape[2])], -1).astype(np.float32)
