"""Additive noise, independent for every pixel and channel, rounded and clipped to [0, 255]."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, Floats, check_settings, setting


class _Noise(ABC):
    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:  # noqa: ARG002
        """The images plus noise."""
        noisy = images.copy()
        for image, rng in zip(noisy, rngs, strict=True):
            image[...] = np.clip(np.rint(image + self._draw(rng, image.shape)), 0, 255)
        return noisy

    @abstractmethod
    def _draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
        """Noise in grey levels."""


@dataclass
class UniformNoise(_Noise):
    """Noise drawn evenly from [-level, level] times 255 (Berenguer, thesis, 4.6.5: level 0.2, 0.4, 0.6).

    The thesis says "random noise with a maximum value of 20 % of the maximum intensity" and leaves the sign open. Here
    the maximum is that of the magnitude, so the mean is 0 and the variance (255 level)^2 / 3. `positive` is the other
    reading, [0, level] times 255: mean 255 level / 2, a quarter of the variance.
    """

    level: float = setting(0.2, at_least=0, at_most=1)  # largest noise, as a share of the maximum intensity
    positive: bool = False  # only brightens

    def __post_init__(self) -> None:
        check_settings(self)

    def _draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
        most = 255 * abs(self.level)  # -0.0 is within the range, and no end of one
        return rng.uniform(0 if self.positive else -most, most, shape)


@dataclass
class GaussianNoise(_Noise):
    """Gaussian noise of mean 0."""

    sigma: float = setting(0.1, at_least=0, at_most=1)  # standard deviation, as a share of the maximum intensity

    def __post_init__(self) -> None:
        check_settings(self)

    def _draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
        return rng.normal(0, abs(255 * self.sigma), shape)  # -0.0 is within the range, and no scale


@dataclass
class ListingNoise(_Noise):
    """Noise as printed in listing 3.5 of Berenguer's thesis: level * (randn - 0.5) * 2, in grey levels.

    That is Gaussian with a mean of -level, not 0, and a standard deviation of 2 level: it darkens the image, too.
    """

    level: float = setting(10.0, at_least=0, at_most=255)  # in grey levels, as in the listing

    def __post_init__(self) -> None:
        check_settings(self)

    def _draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
        return self.level * (rng.standard_normal(shape) - 0.5) * 2
