"""Fourier signature of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.circular_correlation import Spectra
from omnilab_appearance.common.image_ops import channels_of, side_by_side, with_rows


@dataclass
class FourierSignature:
    """Fourier signature: the DFT of each row of the panorama (Menegatti et al., 2004; Berenguer, thesis, 2.1.1).

    `place` holds the magnitudes of the first columns (N, rows, k1), which are invariant under rotation. `heading`
    holds the phases of the columns after the mean, as signals of unit magnitude at these frequencies (N, rows, 4 k2): a
    rotation shifts these, so one correlation over all of them gives it.
    """

    rows: int = setting(64, at_least=1, at_most=8192)  # the panorama is averaged to so many
    magnitudes: int = setting(16, at_least=1, at_most=4096)  # k1, columns of `place`
    phases: int = setting(16, at_least=1, at_most=4096)  # k2, columns of `heading`
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "cityblock"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Magnitudes (N, rows, k1) and headings (N, rows, 4 k2) of panoramas (N, H, W[, 3])."""
        from scipy import fft

        spectra = self._spectra(channels_of(images, self.color))
        place = np.abs(spectra[:, :, : self.magnitudes])
        phases = spectra[:, :, : self.phases + 1].copy()
        modulus = np.abs(phases)
        phases = np.divide(phases, modulus, out=np.zeros_like(phases), where=modulus > 0)
        phases[:, :, 0] = 0
        heading = fft.irfft(phases, 4 * self.phases)
        return side_by_side(Signatures(place.astype(np.float32), heading.astype(np.float32)), self.color)

    def _spectra(self, images: Bytes) -> Spectra:
        """The first frequencies (N, rows, F) of the rows of panoramas (N, H, W)."""
        from scipy import fft

        panoramas = with_rows(images, self.rows)
        return np.asarray(fft.rfft(panoramas)[:, :, : self._frequencies(panoramas.shape[2])])

    def _frequencies(self, width: int) -> int:
        """How many frequencies of rows of `width` samples are used; DataError if they have fewer."""
        columns = width // 2 + 1
        used = max(self.magnitudes, self.phases + 1)
        if used > columns:
            raise DataError(
                f"a panorama of {width} columns has {columns} frequencies, not {self.magnitudes} and"
                f" {self.phases + 1}; give fewer magnitudes and phases"
            )
        return used
