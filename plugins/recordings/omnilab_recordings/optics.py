"""Optics of a recording: the camera, and what is blanked or flipped in each of its images."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Bools, Bytes, Camera, Circle
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.circle import find_circle, inscribed
from omnilab_recordings.images.decoding import DecodedImage, Decoder, reduction
from omnilab_recordings.images.files import read_bytes

ROWS = 512  # of an image at a time


@dataclass(frozen=True)
class Optics:
    """Camera and preprocessing: how the pixels of a file become the picture that is handed over."""

    camera: Camera  # of the picture that is handed over
    unseen: Bools  # (H, W) in the file: set to 0
    mirrored: bool
    decoder: Decoder
    deep: bool  # files have more than 8 bits a sample

    def picture(self, image: DecodedImage, name: str) -> Bytes:
        """A file's pixels, blanked and flipped."""
        check_size(image.shape, self.unseen.shape, name)
        if image.deep != self.deep:
            bits = ("16 (a depth map?)", "8") if image.deep else ("8", "16 (depth maps?)")
            raise DataError(
                f"{name} has {bits[0]} bits a sample, the recording {bits[1]} (sensor.pattern can leave out files)"
            )
        return self.prepared(image.pixels)

    def prepared(self, pixels: Bytes) -> Bytes:
        """Pixels (H, W[, 3]) of the recording's size, blanked in place and flipped."""
        pixels[self.unseen] = 0
        return pixels[:, ::-1] if self.mirrored else pixels

    def key(self, name: str, data: bytes) -> str:
        """`name@digest` of a file's content and of what is done to its pixels."""
        settings = f"{self.decoder} mirrored={self.mirrored}".encode()
        digest = hashlib.sha256(settings + np.packbits(self.unseen).tobytes())
        digest.update(data)
        return f"{name}@{digest.hexdigest()[:16]}"


def check_size(found: tuple[int, ...], shape: tuple[int, ...], name: str) -> None:
    """DataError if an image is not of the recording's size (H, W)."""
    if found != shape:
        raise DataError(f"{name} is {_size(found)} pixels, the recording {_size(shape)}")


def _size(shape: Sequence[int]) -> str:
    return f"{shape[1]} x {shape[0]}"


def most_alike(sample: Mapping[str, DecodedImage]) -> list[DecodedImage]:
    """The images of a sample that have the size and the bits that most of them have; where that is even, 8 bits."""
    kinds = Counter((image.shape, image.deep) for image in sample.values())
    kind = max(kinds, key=lambda kind: (kinds[kind], not kind[1]))
    return [image for image in sample.values() if (image.shape, image.deep) == kind]


def circle_of(circle_px: Sequence[float] | None, sample: Sequence[DecodedImage]) -> Circle:
    """The circle as given, or found in grey images of one size, which may be reduced."""
    height, width = sample[0].shape
    if circle_px is None:
        found = find_circle(np.stack([image.pixels for image in sample]))
        if found == inscribed(sample[0].pixels.shape):
            return inscribed((height, width))
        scale = reduction((height, width))
        cx, cy = (scale * at + (scale - 1) / 2 for at in (found.cx, found.cy))
        return Circle(cx, cy, scale * found.radius, scale * found.inner)
    circle = Circle(*circle_px)
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
    u, off = np.arange(shape[1])[None], np.empty(shape[:2], bool)
    for top in range(0, shape[0], ROWS):  # distances of all pixels of a large image take much memory
        v = np.arange(top, min(top + ROWS, shape[0]))[:, None]
        distance = np.hypot(u - circle.cx, v - circle.cy)
        off[top : top + ROWS] = (distance > circle.radius + 1) | (distance < circle.inner - 1)
    return off


def unseen_in(folder: Path, mask: str, shape: tuple[int, ...]) -> Bools:
    """Pixels (H, W) that are dark in a mask image."""
    try:
        image = Decoder().decode(read_bytes(folder, mask), mask)
        check_size(image.shape, shape, mask)
    except DataError as error:
        raise DataError(f"the mask {error}; give sensor.mask=FILE, an image as large as the others") from error
    return image.pixels < 128
