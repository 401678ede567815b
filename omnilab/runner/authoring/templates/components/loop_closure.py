"""A loop closure: the earlier image that correlates best, if it does well enough."""

from dataclasses import dataclass

import numpy as np
from omnilab import (
    Array,
    Closures,
    Floats,
    Frames,
    ImageFeatures,
    LoopClosure,
    PlaceDatabase,
    Unusable,
    check_settings,
    setting,
)
from omnilab.geometry import wrap_angle
from omnilab.image import panorama, to_gray


@dataclass
class MyLoopClosure:
    """An image shows the place of the earlier one that it correlates with best.

    Panoramas are made small and compared at all rotations. Images that are more alike than
    the threshold are taken to be of one place, whose pose is known to within a step.
    """

    threshold: float = setting(0.95, at_least=-1, at_most=1)  # correlation of one place
    exclude: int = setting(20, at_least=1)  # images just before, always alike
    rows: int = setting(16, at_least=1, at_most=512)  # of the panoramas
    columns: int = setting(128, at_least=16, at_most=8192)  # of them, over 360 degrees
    turn_sigma_deg: float = setting(3.0, above=0)  # standard deviation of the rotation

    def __post_init__(self) -> None:
        check_settings(self)

    def begin(self) -> "Database":
        """A database without images; a run begins one for each trajectory."""
        return Database(self)


class Database:
    """The images of a trajectory so far, numbered as they come."""

    def __init__(self, settings: MyLoopClosure) -> None:
        self._settings = settings
        self._spectra: list[Array] = []  # (rows, frequencies) each

    def query(
        self,
        frames: Frames,
        features: ImageFeatures | Unusable | None,
        step: float,
        rng: np.random.Generator,
    ) -> Closures:
        """The earlier image of the same place, if any; the image becomes one itself."""
        s = self._settings
        self._spectra.append(self._spectrum(frames))
        sigmas = np.array([step, step, np.deg2rad(s.turn_sigma_deg)])
        earlier = len(self._spectra) - 1 - s.exclude
        if earlier <= 0 or isinstance(features, Unusable):
            return _closures([], [], [], sigmas, 0)
        products = self._spectra[-1].conj() * np.stack(self._spectra[:earlier])
        correlation = np.fft.irfft(products.sum(axis=1), s.columns)  # (earlier, shifts)
        node, shift = np.unravel_index(correlation.argmax(), correlation.shape)
        best = float(correlation[node, shift])
        if best < s.threshold:
            return _closures([], [], [], sigmas, earlier)
        turn = float(wrap_angle(2 * np.pi * shift / s.columns))
        return _closures([int(node)], [turn], [1 - best], sigmas, earlier)

    def _spectrum(self, frames: Frames) -> Array:
        """The one image as a small panorama of mean 0 and length 1, transformed."""
        s = self._settings
        image = panorama(to_gray(frames.images), frames.camera, (s.rows, s.columns))[0]
        small = image - image.mean()
        return np.fft.rfft(small / max(float(np.linalg.norm(small)), 1e-12))


def _closures(
    nodes: list[int],
    turns: list[float],
    distances: list[float],
    sigmas: Floats,
    candidates: int,
) -> Closures:
    """K closures at the nodes' own positions, turned from them; sigmas of x, y, heading."""
    count = len(nodes)
    motions = np.zeros((count, 3))
    motions[:, 2] = turns
    covariances = np.tile(np.diag(sigmas**2), (count, 1, 1))
    return Closures(
        np.array(nodes, int), motions, covariances, np.array(distances), candidates
    )


# a type checker compares both with the contract:
_: type[LoopClosure] = MyLoopClosure
__: type[PlaceDatabase] = Database
