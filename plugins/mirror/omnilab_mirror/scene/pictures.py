"""Picture files from anywhere: what may be opened, and what their heads say before they are decoded."""

from __future__ import annotations

import io
import re
import struct
import warnings
import zlib

from PIL import Image

FORMATS = (
    "PNG",
    "JPEG",
    "JPEG2000",
    "BMP",
    "TGA",
    "TIFF",
    "WEBP",
    "GIF",
    "PPM",
    "DDS",
    "AVIF",
)  # EPS would run a program
BROKEN: tuple[type[Exception], ...] = (
    OSError,
    EOFError,
    SyntaxError,
    ValueError,
    LookupError,
    TypeError,
    OverflowError,
)
BROKEN += (NotImplementedError, struct.error, zlib.error, Image.DecompressionBombError)  # what Pillow raises
RADIANCE = re.compile(rb"#\?(?:RADIANCE|RGBE).*?\n\n[-+]Y (\d{1,9}) [-+]X (\d{1,9})\n", re.DOTALL)
DARK = 4095  # the largest value of 12 bits
FRACTIONS = "its pixels are fractions; save it with 8 or 16 bits"


def opened(data: bytes) -> Image.Image:
    """A picture whose head is read, and no pixel; one of `BROKEN` is raised where there is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the size, which is judged by who asks
        return Image.open(io.BytesIO(data), formats=FORMATS)


def complaint(data: bytes, limit: int) -> str:
    """Why a picture of up to `limit` pixels cannot be decoded, "" where it can. Radiance's HDR is known by its head alone."""
    if found := RADIANCE.match(data[:4096]):
        return _too_many(int(found[2]), int(found[1]), limit)
    try:
        with opened(data) as picture:
            if too_many := _too_many(picture.width, picture.height, limit):
                return too_many
            if picture.mode == "F":
                return FRACTIONS
            picture.load()
    except Image.DecompressionBombError:
        return f"it has more than {limit}"
    except BROKEN:
        return "it is no picture, or not all of it"
    return ""


def _too_many(width: int, height: int, limit: int) -> str:
    return f"it has {width} x {height}" if width * height > limit else ""
