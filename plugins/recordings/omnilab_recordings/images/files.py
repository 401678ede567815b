"""Image files: listing and decoding."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from omnilab.api import Bytes
from omnilab.errors import DataError

SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
LARGEST_FILE = 256 * 2**20  # bytes; OpenCV itself refuses more than 2^30 pixels


def image_names(folder: Path, pattern: str) -> list[str]:
    """Paths below the folder of the images that match a glob pattern; numbers in names count (img-2 before img-10).

    What is hidden (its name starts with a dot) is no image.
    """
    found = (file.relative_to(folder) for file in folder.glob(pattern) if file.suffix.lower() in SUFFIXES)
    return sorted((name.as_posix() for name in found if not _hidden(name)), key=_by_number)


def _hidden(name: Path) -> bool:
    return any(part.startswith(".") for part in name.parts)


def _by_number(name: str) -> tuple[list[str | int], str]:
    # the odd pieces are the numbers, so that text never meets a number
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))], name


def read_bytes(folder: Path, name: str) -> bytes:
    """The content of a file below the folder; DataError if it cannot be read or is too large for an image."""
    file = folder / name
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise DataError(f"{name} is larger than {LARGEST_FILE >> 20} MiB")
        return file.read_bytes()
    except OSError as error:
        raise DataError(f"{name} cannot be read ({error.strerror})") from error


def decode(data: bytes, name: str, color: bool = False) -> Bytes:
    """Pixels (H, W), or RGB (H, W, 3), of an image file as they are stored, whatever its orientation tag says.

    DataError if the data are no image, or not the whole of one.
    """
    import cv2

    if data.startswith(b"\xff\xd8") and data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda"):
        raise DataError(f"{name} is truncated: its JPEG data have no end")
    mode = cv2.IMREAD_COLOR_RGB if color else cv2.IMREAD_GRAYSCALE
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), mode | cv2.IMREAD_IGNORE_ORIENTATION) if data else None
    except cv2.error as error:
        raise DataError(f"{name} cannot be decoded ({error.err})") from error
    if pixels is None:
        raise DataError(f"{name} is {'truncated or no image' if data else 'empty'}")
    return np.asarray(pixels, np.uint8)
