"""Loop closures by a threshold on the distance of two descriptors, as printed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import (
    Closures,
    Floats,
    Frames,
    ImageFeatures,
    Ints,
    Signatures,
    Unusable,
    check_settings,
    setting,
)
from omnilab.image import view_of
from omnilab_appearance.descriptors.hog import cell_means, gradient_sums
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.descriptors.radon_hog import RadonHog
from omnilab_appearance.distances.poc import Poc
from omnilab_appearance.loop_closures.cosine_index import CosineIndex


@dataclass
class HogThreshold:
    """Two images show one place if the HOG of their Radon transforms are nearer than W (Berenguer, thesis, eq. 6.6, 6.7).

    The distance is the cosine distance, invariant under rotation; the rotation is that of the transforms by phase-only
    correlation. As printed, every earlier image below W closes a loop; `hog_nearest` takes the nearest alone.
    Images taken shortly before are left out. Images nearer than W by chance close a loop, too: this is as printed, and a
    robust back end should follow.
    """

    w: float = setting(0.006, above=0)  # distance below which two images show one place
    exclude: int = setting(30, at_least=1)  # images just before that are not compared with
    most: int | None = setting(None, at_least=1)  # closures of an image, the nearest ones; null: all below W
    reach: float = setting(1.0, at_least=1e-6, at_most=1e6)  # standard deviation of the position, in usual steps
    turn_sigma_deg: float = setting(2.0, at_least=1e-6, at_most=1e6)  # and of the heading
    cells: int = setting(16, at_least=1, at_most=4096)  # of the HOG
    bins: int = setting(8, at_least=1, at_most=1024)  # of the HOG

    def __post_init__(self) -> None:
        check_settings(self)
        RadonHog(self.cells, self.bins)

    def begin(self) -> HogDatabase:
        """An empty place database."""
        return HogDatabase(self)


@dataclass
class HogNearest(HogThreshold):
    """As `hog_threshold`, but of the images nearer than W only the nearest closes a loop.

    A robot that passes a place several times, or lingers, has few closures there rather than one for each image it took.
    """

    most: int | None = setting(1, at_least=1)  # closures of an image, the nearest ones; null: all below W


class HogDatabase:
    """Place database of HOGs and Radon transforms; HOGs of unusable images are zeros."""

    def __init__(self, settings: HogThreshold) -> None:
        self._settings, self._hogs = settings, CosineIndex()
        self._transforms: list[Floats] = []  # (1, N, M) float16: phases need no more

    def query(
        self,
        frames: Frames,
        features: ImageFeatures | Unusable | None,
        step: float,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Closures:
        """See `omnilab.api.PlaceDatabase`."""
        s = self._settings
        transform = Radon().describe(view_of(frames.images, frames.camera, "mirror", False)).place
        usable = not isinstance(features, Unusable)
        self._hogs.add(hog_of(transform, s.cells, s.bins) if usable else np.zeros(s.cells * s.bins))
        self._transforms.append((transform / max(float(np.abs(transform).max()), 1e-12)).astype(np.float16))
        if not usable:
            return no_closures(0)
        distances = self._hogs.distances(s.exclude)
        near = np.argsort(distances, kind="stable")[: s.most]
        near = near[distances[near] < s.w]
        rotations = np.array([self._rotation(int(node)) for node in near])
        return closures(
            near,
            rotations,
            np.full(len(near), np.deg2rad(s.turn_sigma_deg)),
            s.reach * step,
            distances[near],
            len(near),
        )

    def _rotation(self, node: int) -> float:
        """Heading of the last image less that of a node."""
        poc = Poc()
        before, now = (Signatures(t.astype(np.float32)) for t in (self._transforms[node], self._transforms[-1]))
        rotation = poc.match(now, poc.prepare(before)).rotation_rad
        assert rotation is not None
        return float(rotation[0, 0])


def hog_of(transform: Floats, cells: int, bins: int) -> Floats:
    """HOG (cells, bins) of one Radon transform (1, N, M)."""
    rows, _ = gradient_sums(transform, bins)
    return np.asarray(cell_means(rows, cells)[0])


def closures(
    nodes: Ints, rotations: Floats, rotation_sigma: Floats, position_sigma: float, distances: Floats, candidates: int
) -> Closures:
    """Closures (K,) with zero translation, known to `position_sigma`, and the given rotations (K,)."""
    motions, covariances = np.zeros((len(nodes), 3)), np.zeros((len(nodes), 3, 3))
    motions[:, 2] = rotations
    covariances[:, 0, 0] = covariances[:, 1, 1] = position_sigma**2
    covariances[:, 2, 2] = rotation_sigma**2
    return Closures(nodes, motions, covariances, distances, candidates)


def no_closures(candidates: int) -> Closures:
    """No closures."""
    nothing = np.zeros(0)
    return closures(np.zeros(0, int), nothing, nothing, 1.0, nothing, candidates)
