"""Radon transform of the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Ints, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.image_ops import channels_of, shrunk, side_by_side
from omnilab_appearance.common.sift.two_threads import in_two

LARGE = 200_000  # samples of one image that are worth two threads
KEPT = 400_000  # samples of one image, at most, whose places and weights are kept: 20 bytes each
BLOCK = 32  # images interleaved in the kernel: their pixels share a cache line


@dataclass
class Radon:
    """Radon transform of the mirror image: line integrals at all angles and offsets (Berenguer, thesis, 2.1.2, 4.2.1).

    The image is brought to `offsets` x `offsets` pixels (area average), only its inscribed circle counts, and the
    integrals are sums of bilinear samples one pixel apart, in grey levels times pixels of the original. Signatures are
    (N, offsets, angles); angle m is the direction 2 pi m / angles of the line's normal, counter-clockwise from image
    right. Rotating the camera by alpha shifts the angle axis by alpha * angles / 2 pi (eq. 4.1), exactly so only at
    whole samples. Since R(d, phi + pi) = R(-d, phi), an even number of angles costs half as many directions.
    """

    offsets: int = setting(173, at_least=4, at_most=4096)  # samples across the image circle
    angles: int = setting(180, at_least=4, at_most=4096)  # samples over 360 degrees
    color: bool = False  # each channel of RGB for itself, (N, 3 offsets, angles)

    view: ClassVar[str] = "mirror"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "poc_band"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Radon transforms (N, offsets, angles) float32 of square mirror images (N, S, S[, 3])."""
        channels = channels_of(images, self.color)
        if channels.shape[1] != channels.shape[2]:
            raise DataError(f"images of shape {images.shape} are not square; give (N, S, S), or (N, S, S, 3) in colour")
        blocks = [self._describe(channels[i : i + BLOCK]) for i in range(0, len(channels), BLOCK)]
        place = np.concatenate(blocks) if blocks else np.empty((0, self.offsets, self.angles), np.float32)
        return side_by_side(Signatures(place), self.color)

    def _describe(self, images: Bytes) -> Floats:
        half = self.angles // 2 if self.angles % 2 == 0 else self.angles
        directions = 2 * np.pi * np.arange(half) / self.angles
        scale = images.shape[1] / self.offsets
        integrals = scale * self._line_integrals(images, directions)
        return integrals if half == self.angles else np.concatenate([integrals, integrals[:, ::-1]], axis=2)

    def _line_integrals(self, images: Bytes, directions_rad: Floats) -> Floats:
        """`line_integrals` (N, offsets, M) of images (N, S, S), `BLOCK` at most."""
        return line_integrals(shrink(images, self.offsets), directions_rad)


def shrink(images: Bytes, size: int) -> Floats:
    """Images (N, S, S) as (size, size, N) float32, fading to zero at the inscribed circle. The batch comes last."""
    import cv2

    if images.shape[1] > size:
        fine = np.stack([shrunk(image, size) for image in images])
    else:
        fine = images.astype(np.float32)
        if images.shape[1] < size:
            fine = np.stack([cv2.resize(image, (size, size), interpolation=cv2.INTER_LINEAR) for image in fine])
    last = np.ascontiguousarray(np.moveaxis(fine, 0, -1))
    return last * inside_circle(size)[..., None]


def inside_circle(size: int) -> Floats:
    """1 inside the inscribed circle, fading to 0 over its last fortieth.

    A hard rim of pixels is a pattern of its own, the same in every image, and pulls rotations towards multiples of
    90 degrees (by up to 0.6 degrees, measured; 0.25 with the fading one).
    """
    axis = np.arange(size) - (size - 1) / 2
    inwards = size / 2 - np.hypot(axis[:, None], axis[None, :])
    return np.asarray(np.clip(inwards / max(1.0, size / 40), 0, 1), np.float32)


def line_integrals(images: Floats, directions_rad: Floats, center: float | None = None) -> Floats:
    """Sums along straight lines, (N, n, M) float32, of images (n, n, N) that are zero outside the inscribed circle.

    Line (i, m) has its normal at `directions_rad[m]`, counter-clockwise from image right, and lies i - center pixels
    from the point (center, center); the image's own centre by default.
    """
    from omnilab_appearance.common.kernels import line_sums, line_sums_of_one, sampled_line_sums

    n = len(images)
    padded = np.pad(images, ((2, 2), (2, 2), (0, 0)))
    lines = np.cos(directions_rad), np.sin(directions_rad), (n - 1) / 2 if center is None else center
    if images.shape[2] == 1:
        out = np.empty((len(directions_rad), n), np.float32)
        if n * out.size <= KEPT:
            sampled_line_sums(
                padded[:, :, 0], *_line_samples(n, np.asarray(directions_rad, float).tobytes(), lines[2]), out
            )
        else:
            in_two(partial(line_sums_of_one, padded[:, :, 0], *lines, out), len(out), n * out.size >= LARGE)
        return np.ascontiguousarray(out.T[None])
    return np.ascontiguousarray(line_sums(padded, *lines).transpose(2, 1, 0))


@lru_cache(maxsize=2)
def _line_samples(n: int, directions_rad: bytes, center: float) -> tuple[Ints, Floats, Ints]:
    """`line_samples` of directions float64, kept for the images that follow."""
    from omnilab_appearance.common.kernels import line_samples

    directions = np.frombuffer(directions_rad)
    return line_samples(n, np.cos(directions), np.sin(directions), center)  # type: ignore[no-any-return]


def without_means(transforms: Floats) -> Floats:
    """Radon transforms (N, offsets, angles), less the mean of each offset over all angles, which no rotation changes."""
    return np.asarray(transforms - transforms.mean(axis=2, keepdims=True))


def one_side(values: Floats) -> Floats:
    """The offsets of (..., offsets, angles) from the middle outwards: on the other side are the same lines, half a turn on."""
    return np.ascontiguousarray(values[..., values.shape[-2] // 2 :, :])
