"""RING: spectrum of the Radon transform along the offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_appearance.common.image_ops import bands, channels_of, side_by_side
from omnilab_appearance.descriptors.radon import Radon


@dataclass
class Ring:
    """Magnitudes of the Radon transform's spectrum along the offsets (after Lu et al., RING, 2022).

    A translation of the image's content shifts lines along the offsets, which the magnitudes are invariant to; a rotation
    of the camera shifts the angles. `place` is (N, frequencies, angles). Angles 180 degrees apart have one spectrum, so it
    is ambiguous by 180 degrees; `heading`, the transform itself in coarse bands (N, bands, angles), is not.
    """

    frequencies: int = setting(40, at_least=1, at_most=4096)  # along the offsets, the mean left out
    offsets: int = setting(173, at_least=4, at_most=4096)  # of the Radon transform
    angles: int = setting(180, at_least=4, at_most=4096)  # of the Radon transform
    bands: int = setting(16, at_least=1, at_most=4096)  # of offsets, of the heading part
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "poc_band"

    def __post_init__(self) -> None:
        check_settings(self)
        if not 1 <= self.bands <= self.offsets:
            raise ConfigError(f"bands={self.bands} of {self.offsets} offsets do not exist; give 1 to {self.offsets}")
        if not 1 <= self.frequencies <= self.offsets // 2:
            raise ConfigError(
                f"frequencies={self.frequencies} of {self.offsets} offsets do not exist; give 1 to {self.offsets // 2}"
            )

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of square mirror images (N, S, S[, 3])."""
        from scipy import fft

        transforms = Radon(self.offsets, self.angles).describe(channels_of(images, self.color)).place
        spectra = fft.rfft(transforms, axis=1)[:, 1 : self.frequencies + 1]
        heading = [transforms[:, band].mean(axis=1) for band in bands(self.bands, self.offsets)]
        return side_by_side(Signatures(np.abs(spectra).astype(np.float32), np.stack(heading, 1)), self.color)
