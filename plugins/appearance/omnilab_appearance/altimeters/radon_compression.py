"""Altitude from the compression of the Radon transform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Camera, Floats, Heights, Signatures, check_settings, setting
from omnilab.image import view_of
from omnilab_appearance.common.image_pairs import check_pairs
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.distances.poc import Poc


@dataclass
class RadonCompression:
    """Compression of the Radon transform of one image that resembles the other most (Berenguer, thesis, 5.3.1).

    The transform of the test is rotated by whole samples, by phase-only correlation, then compressed along the
    offsets from N to N - 2a samples, a = 0, 1, ... (eq. 5.5, 5.6), and compared with the middle N - 2a offsets of the
    reference's (eq. 5.7); then with the two exchanged. `value` is the a of the smallest distance, above 0 where it is the
    reference that was compressed: what is seen from higher up lies nearer to the middle (eq. 5.10-5.13). `curves` has
    all distances of both cases, `test_compressed` and `reference_compressed`, and the confidence is how far apart their
    minima are, (d - d') / (d + d'). Eq. 5.7 prints a plain difference; the absolute one is a distance. Its maxima
    "per column" are those over the angles, for each offset.

    It answers 0 within about 0.2 m, and a line up to about 1 m. In a closed room it needs an image that ends not far
    above the horizon: the ceiling expands as the floor contracts.
    """

    offsets: int = setting(250, at_least=4, at_most=4096)  # samples across the image circle, the transform's N
    angles: int = setting(180, at_least=4, at_most=4096)  # samples over 360 degrees, its M
    most: float = setting(
        0.2, above=0, below=0.5
    )  # share of the offsets that the strongest compression takes off at either end

    def __post_init__(self) -> None:
        check_settings(self)

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Compressions in samples of the offset axis."""
        check_pairs(references, tests, camera)
        views = view_of(np.concatenate([references, tests]), camera, "mirror", False)
        both = Radon(self.offsets, self.angles).describe(views)  # at once: a pair takes hardly longer than one
        known, queried = both[slice(len(references))], both[slice(len(references), None)]
        rotation = _rotations(known, queried)
        shifts = np.rint(rotation * self.angles / (2 * np.pi)).astype(int)
        rotated = np.stack([np.roll(one, shift, axis=1) for one, shift in zip(queried.place, shifts, strict=True)])
        falling, rising = compressions(known.place, rotated, int(self.most * self.offsets) + 1)
        return heights_of(falling, rising, rotation)


def compressions(reference: Floats, test: Floats, count: int) -> tuple[Floats, Floats]:
    """Distances (T, count) of tests (T, N, M) from one reference or T, at a = 0, 1, ...: tests compressed, and references."""
    from omnilab_appearance.common.kernels import compressed_distances

    return compressed_distances(reference, test, count), compressed_distances(test, reference, count)


def heights_of(falling: Floats, rising: Floats, rotation_rad: Floats) -> Heights:
    """Heights from the distances (N, count) of both cases."""
    down, up = falling.min(axis=1), rising.min(axis=1)
    value = np.where(up < down, rising.argmin(axis=1), -falling.argmin(axis=1)).astype(float)
    both = up + down
    confidence = np.divide(np.abs(up - down), both, out=np.zeros_like(both), where=both > 0)
    curves = {"test_compressed": falling, "reference_compressed": rising}
    return Heights(value, "samples", confidence, rotation_rad, curves)


def _rotations(references: Signatures, tests: Signatures) -> Floats:
    """Test heading - reference heading (N,)."""
    poc = Poc()
    if len(references) == 1:
        pairs = [poc.match(tests, poc.prepare(references))]
    else:
        pairs = [poc.match(tests[i : i + 1], poc.prepare(references[i : i + 1])) for i in range(len(tests))]
    return np.concatenate([pair.rotation_rad for pair in pairs if pair.rotation_rad is not None]).ravel()
