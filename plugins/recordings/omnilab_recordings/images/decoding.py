"""Image files decoded: the one place where bytes become pixels, within bounds that their headers are held to."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from omnilab.api import Array, Bytes
from omnilab.errors import DataError
from omnilab_recordings.images.headers import ImageHeader, read_header
from omnilab_recordings.images.library_output import LIBRARY_OUTPUT

MOST_PIXELS = 2**27  # 16384 x 8192: decoded, that is 134 MB in grey
LARGE = 2**25  # pixels from which on images are decoded one at a time
REDUCED = 2**22  # pixels to which larger images are reduced where nothing finer is looked for
BROKEN = re.compile(
    r"Corrupt JPEG data: (?!\d+ extraneous bytes before marker 0xd9)|Premature end of JPEG|libpng error"
    r"|TIFF_Error|JPEGLib: Corrupt|PackBitsDecode"
)
STRAY = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd9")
FEW_STRAY = 3  # bytes before its end that a camera may have left in a JPEG; more are what could not be decoded


@dataclass(frozen=True)
class DecodedImage:
    """Pixels, and what a user may want to know of how they came about."""

    pixels: Bytes  # (H, W), or RGB (H, W, 3)
    header: ImageHeader
    shape: tuple[int, int]  # (H, W), also once the pixels are reduced
    peak: int = 255  # largest value of a sample in the file
    transparent: bool = False  # some pixels are, which makes them black
    stray_bytes: bool = False  # its JPEG data may be damaged

    @property
    def deep(self) -> bool:
        """Whether samples have more than 8 bits."""
        return self.header.bits > 8

    def reduced(self) -> DecodedImage:
        """The same with `reduction` x `reduction` pixels as one, where the image is large."""
        return replace(self, pixels=reduce_by(self.pixels, reduction(self.shape)))


@dataclass(frozen=True)
class Decoder:
    """How image files become pixels of 8 bits."""

    color: bool = False  # RGB instead of grey
    exif_orientation: bool = True  # turned as viewers show them, or as stored
    bits: int | None = None  # that files of 16 bits use; None: as they declare, or all

    def decode(self, data: bytes, name: str) -> DecodedImage:
        """The first page of an image file; DataError if the data are no image, not the whole of one, or too large.

        Samples of more than 8 bits are scaled by the value that the file declares to be white. What is transparent
        shows through to black.
        """
        header = self._header(data, name)
        if header.orientation_at is not None:  # the library turns a TIFF whether it is wanted or not
            data = _with_upright_tag(data, header.orientation_at)
        large = header.width * header.height > LARGE
        pixels, text = LIBRARY_OUTPUT.of(lambda: _imdecode(data, name, self._mode(header)), alone=large)
        stray = _stray_bytes(text, data, header)
        if BROKEN.search(text) or stray > FEW_STRAY:
            raise DataError(
                f"{name} is damaged: its {header.format} data are broken, and the picture is not what was taken"
            )
        if pixels is None or pixels.shape[:2] != (header.height, header.width):
            raise DataError(f"{name} is truncated or no image")
        peak = int(pixels.max())
        shown, transparent = _over_black(self._scaled(pixels, header, peak, name), data, name, header)
        turned = _turned(shown, header.orientation) if self.exif_orientation else shown
        return DecodedImage(turned, header, turned.shape[:2], peak, transparent, stray > 0)

    def _header(self, data: bytes, name: str) -> ImageHeader:
        if not data:
            raise DataError(f"{name} is empty")
        header = read_header(data, name)
        if header is None or min(header.width, header.height) < 1:
            raise DataError(f"{name} is truncated or no image")
        for width, height in ((header.width, header.height), header.tile):
            if width * height > MOST_PIXELS:
                raise DataError(
                    f"{name} is {width} x {height} pixels, more than the {MOST_PIXELS // 10**6} million that are read"
                    " (scale it down)"
                )
        if header.numbers != "unsigned" or header.bits > 16 or (header.format == "JPEG" and header.bits > 8):
            kind = "" if header.numbers == "unsigned" else f" {header.numbers}"
            raise DataError(
                f"{name} holds {header.bits}-bit{kind} samples, which are no grey levels of a picture"
                " (save it with 8 or 16 bits a sample)"
            )
        if header.format == "JPEG" and data.find(b"\xff\xd9", header.scan_at) < 0:
            raise DataError(f"{name} is truncated: its JPEG data have no end")
        return header

    def _mode(self, header: ImageHeader) -> int:
        import cv2

        mode = cv2.IMREAD_COLOR_RGB if self.color else cv2.IMREAD_GRAYSCALE
        return mode | cv2.IMREAD_IGNORE_ORIENTATION | (cv2.IMREAD_ANYDEPTH if header.bits > 8 else 0)

    def _scaled(self, pixels: Array, header: ImageHeader, peak: int, name: str) -> Bytes:
        """Samples as 8 bits: white is what the file declares, or the setting does."""
        import cv2

        if header.bits <= 8:
            binary = header.format in {"P5", "P6"} and header.largest < 255  # others were scaled by the library
            return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / header.largest) if binary else pixels, np.uint8)
        white = header.largest if self.bits is None else 2**self.bits - 1
        if peak > white:
            by = "it declares to be white" if self.bits is None else f"are white by sensor.bits={self.bits}"
            raise DataError(
                f"{name} has samples of {peak}, more than the {white} that {by} (give sensor.bits={peak.bit_length()})"
            )
        if header.inverted:
            pixels = white - pixels
        return (pixels >> 8).astype(np.uint8) if white == 65535 else cv2.convertScaleAbs(pixels, alpha=255 / white)


def _imdecode(data: bytes, name: str, mode: int) -> Array | None:
    import cv2

    try:
        found: Array | None = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    except cv2.error:
        raise DataError(f"{name} is damaged, or of a kind of {name.rpartition('.')[2]} file that is not read") from None
    return found


def _with_upright_tag(data: bytes, at: int) -> bytes:
    """A TIFF that says it is upright."""
    return data[:at] + (1).to_bytes(2, "little" if data[:2] == b"II" else "big") + data[at + 2 :]


def _stray_bytes(text: str, data: bytes, header: ImageHeader) -> int:
    """How many bytes before the end of JPEG data could not be decoded and are more than filling."""
    found = STRAY.search(text)
    if found is None:
        return 0
    count, end = int(found[1]), data.find(b"\xff\xd9", header.scan_at)
    filling = count > 1 and len(set(data[end - count : end])) == 1
    return 0 if filling else count


def _over_black(pixels: Bytes, data: bytes, name: str, header: ImageHeader) -> tuple[Bytes, bool]:
    """Pixels in front of black, and whether any is transparent."""
    import cv2

    if not header.alpha:
        return pixels, False
    mode = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    layers, _ = LIBRARY_OUTPUT.of(lambda: _imdecode(data, name, mode), alone=pixels.size > LARGE)
    if layers is None or layers.ndim != 3 or layers.shape[2] != 4:
        return pixels, False
    opaque = np.iinfo(layers.dtype).max
    alpha = layers[..., 3]
    if alpha.min() == opaque:
        return pixels, False
    if header.format == "TIFF" and header.bits == 8:  # the library has done that itself
        return pixels, True
    share = cv2.convertScaleAbs(alpha, alpha=255 / opaque)
    return np.asarray(
        cv2.multiply(pixels, share if pixels.ndim == 2 else cv2.merge([share] * 3), scale=1 / 255), np.uint8
    ), True


def _turned(pixels: Bytes, orientation: int) -> Bytes:
    """The picture upright, as EXIF's orientation 1 to 8 says that it was taken."""
    if orientation in {5, 6, 7, 8}:
        pixels = pixels.swapaxes(0, 1)
    if orientation in {2, 3, 6, 7}:
        pixels = pixels[:, ::-1]
    if orientation in {3, 4, 7, 8}:
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def reduction(shape: tuple[int, ...]) -> int:
    """How many pixels a side of an image (H, W) become one where it is reduced; 1: it is not."""
    return math.ceil(math.sqrt(shape[0] * shape[1] / REDUCED))


def reduce_by(pixels: Bytes, factor: int) -> Bytes:
    """An image whose pixels are the means of `factor` x `factor` of another's; what is left at the far edges is cut."""
    if factor == 1:
        return pixels
    import cv2

    height, width = (side // factor for side in pixels.shape[:2])
    whole = pixels[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
