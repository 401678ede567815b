"""Power spectrum of the sphere, degree by degree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.image_ops import channels_of, side_by_side
from omnilab_appearance.common.spheres import coefficients_of
from omnilab_appearance.common.spherical_harmonics import power


@dataclass
class SphericalPower:
    """The amplitude of each degree of the spherical harmonics, which no rotation of the camera changes (Kazhdan et al., 2003).

    Signatures are (N, 1, degrees): root of sum over m of |f_lm|^2 for l from 1 to `degrees`, f the sphere in standard
    deviations from its mean, so that gain and offset of the light change nothing. On a whole sphere this holds for all
    three angles, tilt included; what a mirror does not show tilts with it.
    """

    degrees: int = setting(32, at_least=1, at_most=63)  # the finest is 180 / degrees degrees wide
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "sphere"
    rotation: ClassVar[str] = "invariant"
    default_distance: ClassVar[str] = "euclidean"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Amplitudes (N, 1, degrees) of spheres (N, H, 2 H[, 3])."""
        pictures = channels_of(images, self.color)
        found = [np.sqrt(power(coefficients_of(picture, self.degrees + 1)[0]))[1:] for picture in pictures]
        return side_by_side(Signatures(np.array(found, np.float32)[:, None]), self.color)
