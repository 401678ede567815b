"""An odometry: a visual compass, and steps of one length."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from omnilab import (
    Floats,
    Frames,
    Motion,
    Odometry,
    Unusable,
    check_settings,
    setting,
)
from omnilab.geometry import wrap_angle
from omnilab.image import panorama, to_gray


@dataclass
class MyOdometry:
    """A visual compass for a robot that drives straight ahead by steps of one length.

    The rotation is the shift at which two panoramas correlate best (Labrosse, 2006); the
    robot is taken to drive an arc of that rotation. Settings say how far off that is.
    """

    step_m: float = setting(0.1, above=0, at_most=1000)  # length of every step
    rows: int = setting(16, at_least=1, at_most=512)  # of the panoramas
    columns: int = setting(512, at_least=16, at_most=8192)  # of them, over 360 degrees
    step_sigma_m: float = setting(0.05, above=0)  # standard deviation of x and y
    turn_sigma_deg: float = setting(1.0, above=0)  # standard deviation of the rotation

    def __post_init__(self) -> None:
        check_settings(self)

    def extract(self, frames: Frames) -> Sequence[Floats | Unusable]:
        """Each image as a small panorama (rows, columns) of mean 0."""
        shape = (self.rows, self.columns)
        images = panorama(to_gray(frames.images), frames.camera, shape).astype(float)
        small = images - images.mean(axis=(1, 2), keepdims=True)
        return [p if p.any() else Unusable("it is of one grey level") for p in small]

    def estimate(self, before: Floats, now: Floats, rng: np.random.Generator) -> Motion:
        """The motion between two images, from what `extract` gave of them."""
        spectra = np.fft.rfft(now).conj() * np.fft.rfft(before)
        correlation = np.fft.irfft(spectra.sum(axis=0), self.columns)
        turn = float(wrap_angle(2 * np.pi * correlation.argmax() / self.columns))
        along = turn / 2  # the chord of an arc lies between both headings
        vector = [self.step_m * np.cos(along), self.step_m * np.sin(along), turn]
        turn_sigma = np.deg2rad(self.turn_sigma_deg)
        sigmas = np.array([self.step_sigma_m, self.step_sigma_m, turn_sigma])
        return Motion(np.array(vector), np.diag(sigmas**2), "m")


# a type checker compares it with the contract:
_: type[Odometry] = MyOdometry
