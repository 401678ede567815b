"""Optics of a recording: the camera, and what is blanked or flipped in each of its images."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Bools, Bytes, Camera, Circle
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.circle import find_circle
from omnilab_recordings.images.decoding import decode
from omnilab_recordings.images.files import read_bytes


@dataclass(frozen=True)
class Optics:
    """Camera and preprocessing: how the pixels of a file become the picture that is handed over."""

    camera: Camera  # of the picture that is handed over
    unseen: Bools  # (H, W) in the file: set to 0
    mirrored: bool
    color: bool

    def picture(self, pixels: Bytes, name: str) -> Bytes:
        """A file's pixels, blanked and flipped."""
        check_size(pixels, self.unseen.shape, name)
        pixels[self.unseen] = 0
        return pixels[:, ::-1] if self.mirrored else pixels

    def key(self, name: str, data: bytes) -> str:
        """`name@digest` of a file's content and of what is done to its pixels."""
        settings = f"color={self.color} mirrored={self.mirrored}".encode()
        digest = hashlib.sha256(settings + np.packbits(self.unseen).tobytes())
        digest.update(data)
        return f"{name}@{digest.hexdigest()[:16]}"


def check_size(pixels: Bytes, shape: tuple[int, ...], name: str) -> None:
    """DataError if an image is not of the recording's size (H, W)."""
    if pixels.shape[:2] != shape:
        raise DataError(f"{name} is {_size(pixels.shape)} pixels, the recording {_size(shape)}")


def _size(shape: Sequence[int]) -> str:
    return f"{shape[1]} x {shape[0]}"


def most_common_size(sample: Sequence[Bytes]) -> list[Bytes]:
    """The grey images of a sample that have the size that most of them have."""
    shape, _ = Counter(image.shape for image in sample).most_common(1)[0]
    return [image for image in sample if image.shape == shape]


def circle_of(circle_px: Sequence[float] | None, sample: Sequence[Bytes]) -> Circle:
    """The circle as given, or found in grey images of one size."""
    if circle_px is None:
        return find_circle(np.stack(sample))
    circle = Circle(*circle_px)
    height, width = sample[0].shape
    if not (0 <= circle.cx < width and 0 <= circle.cy < height):
        raise ConfigError(
            f"circle_px={list(circle_px)} has its centre outside the {width} x {height} image; give [cx,cy,radius] in pixels"
        )
    return circle


def check_circle(circle_px: Sequence[float]) -> None:
    """ConfigError if the numbers are no circle or ring."""
    if len(circle_px) not in {3, 4} or not all(map(math.isfinite, circle_px)):
        raise ConfigError(f"circle_px={list(circle_px)} is no circle; give [cx,cy,radius] or [cx,cy,radius,inner]")
    circle = Circle(*circle_px)
    if not 0 <= circle.inner < circle.radius:
        raise ConfigError(
            f"circle_px={list(circle_px)} leaves no ring from {circle.inner} to {circle.radius} pixels;"
            " give a radius above the inner radius, both in pixels"
        )


def off_ring(circle: Circle, shape: tuple[int, ...]) -> Bools:
    """Pixels (H, W) off the ring by more than one, so that interpolation on its edge meets no blank."""
    if circle.radius == 0:
        raise ConfigError("blank_outside=true, but this camera has no image circle; give blank_outside=false")
    v, u = np.indices(shape[:2])
    distance = np.hypot(u - circle.cx, v - circle.cy)
    return np.asarray((distance > circle.radius + 1) | (distance < circle.inner - 1))


def unseen_in(folder: Path, mask: str, shape: tuple[int, ...]) -> Bools:
    """Pixels (H, W) that are dark in a mask image."""
    try:
        pixels = decode(read_bytes(folder, mask), mask)
        check_size(pixels, shape, mask)
    except DataError as error:
        raise DataError(f"the mask {error}; give sensor.mask=FILE, an image as large as the others") from error
    return pixels < 128
