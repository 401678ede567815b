"""Headers of image files: size, bits, pages and orientation, known before anything is decoded."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from omnilab.errors import DataError

FULL = 2**16 - 1
MOST_PAGES = 10_000  # that are counted
OTHERS = {  # how files begin that are no images of a kind that is read, whatever their names say
    "a GIF": rb"GIF8",
    "a JPEG 2000": rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51",
    "a HEIC": rb"....ftyp(hei|hev|mif1|msf1)",
    "an AVIF": rb"....ftypavi",
    "a JPEG XL": rb"\xff\x0a|\0\0\0\x0cJXL ",
    "an OpenEXR": rb"\x76\x2f\x31\x01",
    "a Radiance HDR": rb"#\?R",
    "a PFM (floating-point) image": rb"P[fF]\s",
    "a PAM image": rb"P7\n",
    "a Photoshop": rb"8BPS",
    "a FITS": rb"SIMPLE  =",
    "a NumPy array": rb"\x93NUMPY",
    "a PDF": rb"%PDF",
    "an SVG": rb"\s*(<\?xml[^>]*>\s*)?<svg",
    "a web page": rb"\s*<(!doctype|html)",
}


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says of itself."""

    format: str
    width: int  # as stored, whatever the orientation
    height: int
    bits: int = 8  # of a sample
    largest: int = 255  # value of a sample that is declared to be white
    numbers: str = "unsigned"  # or signed, or floating-point
    alpha: bool = False
    inverted: bool = False  # 0 is white
    pages: int = 1  # or frames
    orientation: int = 1  # as EXIF counts: 1 is upright
    orientation_at: int | None = None  # of a TIFF: where the file says so
    tile: tuple[int, int] = (0, 0)  # of a TIFF that has tiles: their width and height
    scan_at: int = 0  # of a JPEG: where its first scan begins
    equirectangular: bool = False  # declared a panorama of the sphere (Google's GPano)


def read_header(data: bytes, name: str) -> ImageHeader | None:
    """The header of an image file; None if it is none or is cut short. DataError names a file of another kind."""
    for magic, parse in PARSERS.items():
        if re.match(magic, data, re.DOTALL):
            try:
                return parse(data)
            except (struct.error, LookupError, OverflowError, ValueError):
                return None
    if data.startswith(b"version https://git-lfs"):
        raise DataError(f"{name} is but a pointer of Git LFS to the image (git lfs pull fetches it)")
    for kind, magic in OTHERS.items():
        if re.match(magic, data[:400], re.DOTALL | re.IGNORECASE):
            raise DataError(f"{name} is {kind}, whatever its name says (save it as PNG, JPEG or TIFF)")
    return None


def _png(data: bytes) -> ImageHeader:
    kind, width, height, bits, color = struct.unpack_from(">4sIIBB", data, 12)
    if kind != b"IHDR":
        raise ValueError("PNG without header")
    alpha, frames, orientation = color in {4, 6}, 1, 1
    at = 8
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, at)
        body = at + 8
        if body + length > len(data):  # the library would make room for it first
            raise ValueError("PNG with a chunk longer than the file")
        alpha |= kind == b"tRNS"
        if kind == b"acTL":
            (frames,) = struct.unpack_from(">I", data, body)
        elif kind == b"eXIf":
            orientation = exif_orientation(data[body : body + length])
        at = body + length + 4
    return ImageHeader("PNG", width, height, bits, 2**bits - 1, alpha=alpha, pages=frames, orientation=orientation)


def _jpeg(data: bytes) -> ImageHeader:
    frame: tuple[int, int, int] | None = None
    orientation, equirectangular, at = 1, False, 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte
            at += 1
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        body = data[at + 4 : at + 2 + length]
        if marker == 0xDA and frame is not None:
            bits, height, width = frame
            return ImageHeader("JPEG", width, height, bits, 2**bits - 1, orientation=orientation, scan_at=at, equirectangular=equirectangular)  # fmt: skip
        if frame is None and 0xC0 <= marker <= 0xCF and marker not in {0xC4, 0xC8, 0xCC}:
            frame = struct.unpack_from(">BHH", body)
        elif marker == 0xE1 and body.startswith(b"Exif\0"):
            orientation = exif_orientation(body[6:])
        elif marker == 0xE1:  # XMP
            equirectangular |= re.search(rb"ProjectionType\W{1,4}equirectangular", body) is not None
        at += 2 + length
    raise ValueError("JPEG without frame or scan")


def _pnm(data: bytes) -> ImageHeader:
    """Netpbm's: the magic number, width, height and, but for bitmaps, the value of white, with comments between."""
    tokens = re.match(rb"P([1-6])((?:(?:\s|#[^\n]*\n)+\d+){2,3})", data)
    if tokens is None:
        raise ValueError("PNM without header")
    kind = int(tokens[1])
    numbers = [int(number) for number in re.sub(rb"#[^\n]*\n", b" ", tokens[2]).split()]
    width, height, *largest = numbers
    white = 1 if kind in {1, 4} else largest[0]
    if not 0 < white < 2**16:
        raise ValueError("PNM without white")
    return ImageHeader(
        f"P{kind}", width, height, 1 if white == 1 and kind in {1, 4} else 16 if white > 255 else 8, white
    )


def _bmp(data: bytes) -> ImageHeader:
    (size,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if size == 12 else "<ii", data, 18)
    return ImageHeader("BMP", abs(width), abs(height))


def _webp(data: bytes) -> ImageHeader:
    kind, body = data[12:16], 20
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, body + 6)
        return ImageHeader("WebP", width & 0x3FFF, height & 0x3FFF)
    if kind == b"VP8L":
        (fields,) = struct.unpack_from("<I", data, body + 1)
        return ImageHeader("WebP", 1 + (fields & 0x3FFF), 1 + (fields >> 14 & 0x3FFF), alpha=bool(fields >> 28 & 1))
    width, height = (1 + int.from_bytes(data[at : at + 3], "little") for at in (body + 4, body + 7))
    frames, orientation, at = 0, 1, 12
    while at + 8 <= len(data):
        kind, length = struct.unpack_from("<4sI", data, at)
        frames += kind == b"ANMF"
        if kind == b"EXIF":
            orientation = exif_orientation(data[at + 8 : at + 8 + length].removeprefix(b"Exif\0\0"))
        at += 8 + length + length % 2
    alpha = bool(data[body] & 0x10)
    return ImageHeader("WebP", width, height, alpha=alpha, pages=max(frames, 1), orientation=orientation)


# -------------------------------------------------------------------------------------------------------------- TIFF
SUBFILE, WIDTH, HEIGHT, BITS, PHOTOMETRIC, ORIENTATION = 254, 256, 257, 258, 262, 274
TILE_WIDTH, TILE_HEIGHT, EXTRA, SAMPLES = 322, 323, 338, 339
TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}  # bytes, shorts, longs, and BigTIFF's
NUMBERS = {1: "unsigned", 2: "signed", 3: "floating-point", 4: "unsigned", 5: "complex signed", 6: "complex"}
Directory = dict[int, tuple[int, int]]  # by tag: the first value, and where it stands


def _tiff(data: bytes) -> ImageHeader:
    first, *others = _directories(data)
    value = {tag: found for tag, (found, _) in first.items()}
    bits = value.get(BITS, 1)
    return ImageHeader(
        "TIFF",
        value[WIDTH],
        value[HEIGHT],
        bits,
        2**bits - 1 if bits <= 8 else FULL,  # the library shifts fewer bits up
        NUMBERS.get(value.get(SAMPLES, 1), "unknown"),
        alpha=value.get(EXTRA) in {1, 2},
        inverted=value.get(PHOTOMETRIC) == 0,
        pages=1 + sum(not page.get(SUBFILE, (0, 0))[0] & 1 for page in others),  # others are smaller copies of a page
        orientation=_upright(value.get(ORIENTATION, 1)),
        orientation_at=first.get(ORIENTATION, (0, None))[1],
        tile=(value.get(TILE_WIDTH, 0), value.get(TILE_HEIGHT, 0)),
    )


def exif_orientation(exif: bytes) -> int:
    """The orientation 1 to 8 that an EXIF block, a TIFF without picture, gives; 1 if it gives none."""
    try:
        return _upright(next(_directories(exif)).get(ORIENTATION, (1, 0))[0])
    except (struct.error, LookupError, OverflowError, ValueError, StopIteration):
        return 1


def _upright(orientation: int) -> int:
    return orientation if 1 <= orientation <= 8 else 1


def _directories(data: bytes) -> Iterator[Directory]:
    """The directories of a TIFF, one a page; what is not a number is left out. ValueError if there is none."""
    order = {b"II": "<", b"MM": ">"}[data[:2]] if data[:2] in {b"II", b"MM"} else ""
    if not order:
        raise ValueError("no TIFF")
    (version,) = struct.unpack_from(order + "H", data, 2)
    counts, offsets, entry = ("Q", "Q", "HHQ8s") if version == 43 else ("H", "I", "HHI4s")
    (at,) = struct.unpack_from(order + offsets, data, 8 if version == 43 else 4)
    seen = set[int]()
    while at and at not in seen and len(seen) < MOST_PAGES:
        seen.add(at)
        (count,) = struct.unpack_from(order + counts, data, at)
        start, size = at + struct.calcsize(order + counts), struct.calcsize(order + entry)
        if count * size > len(data):
            raise ValueError("TIFF with a directory longer than the file")
        directory = Directory()
        for i in range(count):
            tag, kind, values, field = struct.unpack_from(order + entry, data, start + i * size)
            if kind in TYPES and values > 0:
                place = start + (i + 1) * size - len(field)
                if values * struct.calcsize(TYPES[kind]) > len(field):
                    (place,) = struct.unpack(order + offsets, field)
                directory[tag] = struct.unpack_from(order + TYPES[kind], data, place)[0], place
        yield directory
        (at,) = struct.unpack_from(order + offsets, data, start + count * size)


PARSERS: dict[bytes, Callable[[bytes], ImageHeader]] = {
    rb"\x89PNG\r\n\x1a\n": _png,
    rb"\xff\xd8\xff": _jpeg,
    rb"P[1-6]\s": _pnm,
    rb"BM": _bmp,
    rb"RIFF....WEBP": _webp,
    rb"II[\x2a\x2b]\0|MM\0[\x2a\x2b]": _tiff,
}
