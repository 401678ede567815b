"""Ring key of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.image_ops import channels_of, side_by_side, with_rows


@dataclass
class RingKey:
    """The magnitudes of a few frequencies of each ring around the robot (after Kim & Kim, Scan Context, 2018).

    With one frequency these are the rings' means, the ring key; with more, the magnitude of the polar FFT. Signatures
    are (N, rings, frequencies), invariant under rotation.
    """

    rings: int = setting(32, at_least=1, at_most=8192)  # rows of the panorama
    frequencies: int = setting(1, at_least=1, at_most=8192)  # 1: the mean alone

    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "euclidean"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Magnitudes (N, rings, frequencies), in grey levels, of panoramas (N, H, W[, 3])."""
        from scipy import fft

        spectra = fft.rfft(with_rows(channels_of(images, self.color), self.rings), norm="forward")
        if self.frequencies > spectra.shape[2]:
            raise DataError(
                f"rings of {images.shape[2]} pixels have {spectra.shape[2]} frequencies, not {self.frequencies}; give fewer"
            )
        return side_by_side(Signatures(np.abs(spectra[:, :, : self.frequencies]).astype(np.float32)), self.color)
