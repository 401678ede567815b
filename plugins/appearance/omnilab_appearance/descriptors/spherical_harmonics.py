"""Spherical harmonics of the sphere around the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.image_ops import channels_of
from omnilab_appearance.common.spheres import coefficients_of


@dataclass
class SphericalHarmonics:
    """The sphere's spherical harmonics up to a degree, which `so3_correlation` compares over all rotations.

    Signatures are (N, 3, band_limit^2): the real coefficients of m f, m f^2 and m, where f is the sphere in standard
    deviations from its mean and m is 1 where the camera sees, so that a mirror, which sees a part, can be compared too
    (Makadia and Daniilidis, 2006; the masks as in Padfield, 2012). A rotation mixes the orders of each degree.
    """

    band_limit: int = setting(
        16, at_least=2, at_most=32
    )  # degrees below it; a grid of rotations steps 180 / band_limit

    view: ClassVar[str] = "sphere"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"  # of the last axis; the distance finds it
    default_distance: ClassVar[str] = "so3_correlation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Coefficients (N, 3, band_limit^2) of spheres (N, H, 2 H)."""
        found = [coefficients_of(picture, self.band_limit) for picture in channels_of(images, self.color)]
        return Signatures(np.array(found, np.float32))
