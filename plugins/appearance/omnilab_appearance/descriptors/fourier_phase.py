"""Phases of the Fourier signature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.image_ops import channels_of, side_by_side, with_rows


@dataclass
class FourierPhase:
    """The Fourier signature's phases in place of its magnitudes, which light changes: each row whitened.

    The first `frequencies` of each row's DFT after the mean (Menegatti et al., 2004), every one divided by its
    magnitude (as phase-only correlation does: Kuglin & Hines, 1975), as signals (N, rows, 4 frequencies), which a
    rotation shifts. A gain and an offset of a row's grey levels change nothing. Rows without texture are zero.
    """

    rows: int = setting(64, at_least=1, at_most=8192)  # the panorama is averaged to so many
    frequencies: int = setting(32, at_least=1, at_most=4096)  # of each row
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "circular_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Whitened rows (N, rows, 4 frequencies) of panoramas (N, H, W[, 3])."""
        from scipy import fft

        panoramas = with_rows(channels_of(images, self.color), self.rows)
        columns = panoramas.shape[2] // 2 + 1
        if self.frequencies + 1 > columns:
            raise DataError(
                f"a panorama of {panoramas.shape[2]} columns has {columns} frequencies, not {self.frequencies + 1};"
                " give fewer"
            )
        spectra = fft.rfft(panoramas)[:, :, : self.frequencies + 1]
        modulus = np.abs(spectra)
        heard = modulus > 1e-6 * modulus.max(axis=(1, 2), keepdims=True)  # below that a phase is rounding
        phases = np.divide(spectra, modulus, out=np.zeros_like(spectra), where=heard & (modulus > 0))
        phases[:, :, 0] = 0
        return side_by_side(Signatures(fft.irfft(phases, 4 * self.frequencies).astype(np.float32)), self.color)
