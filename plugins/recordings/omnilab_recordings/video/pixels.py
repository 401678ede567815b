"""Decoded frames as grey or RGB images: ranges, depths and matrices of colours, the same on every machine."""

from __future__ import annotations

import re
from enum import Enum
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bytes

if TYPE_CHECKING:
    from av import VideoFrame

LUMA_FIRST = re.compile(r"(yuva?j?4\d\dp|gray|nv\d\d)(9|10|12|14|16)?(le)?")  # formats whose first plane is the luma
HIGH_DEFINITION = 720  # rows from which on colours are of BT.709 where nothing says of which


class LumaRange(Enum):
    """Which values of luma are black and white."""

    auto = "auto"  # as the video says; where it does not, grey ones are full and others limited, as players take them
    full = "full"  # 0 and 255
    limited = "limited"  # 16 and 235


def image_of(frame: VideoFrame, color: bool, wanted: LumaRange) -> Bytes:
    """A frame (H, W), or RGB (H, W, 3), uint8.

    Grey is the luma itself, stretched where its range is limited; of videos in RGB it is their Rec. 601 luma. RGB of
    luma and chroma is made in software, bit-exact.
    """
    full = _is_full(frame, wanted)
    if color:
        return _rgb(frame, full)
    if LUMA_FIRST.fullmatch(frame.format.name):
        return _luma(frame, full)
    if frame.format.is_rgb or frame.format.has_palette:
        import cv2

        return np.asarray(cv2.cvtColor(_rgb(frame, full), cv2.COLOR_RGB2GRAY), np.uint8)
    deep = "16le" if frame.format.components[0].bits > 8 else ""
    return _luma(frame.reformat(format=f"yuv444p{deep}"), full)


def turned(image: Bytes, rotation_deg: int) -> Bytes:
    """An image turned counter-clockwise by a multiple of 90 degrees, as its video says that it is shown."""
    return np.ascontiguousarray(np.rot90(image, rotation_deg // 90)) if rotation_deg else image


def _is_full(frame: VideoFrame, wanted: LumaRange) -> bool:
    from av.video.reformatter import ColorRange

    if wanted is not LumaRange.auto:
        return wanted is LumaRange.full
    if frame.color_range == ColorRange.UNSPECIFIED:
        return frame.format.name.startswith(("gray", "yuvj")) or frame.format.is_rgb
    return bool(frame.color_range == ColorRange.JPEG)


def _luma(frame: VideoFrame, full: bool) -> Bytes:
    bits, plane = frame.format.components[0].bits, frame.planes[0]
    samples = np.frombuffer(memoryview(plane), np.dtype("u1" if bits == 8 else "<u2")).reshape(frame.height, -1)[
        :, : frame.width
    ]
    if full and bits == 8:
        return np.array(samples, np.uint8)
    return np.asarray(_levels(bits, full)[np.minimum(samples, 2**bits - 1)])


@lru_cache(maxsize=8)
def _levels(bits: int, full: bool) -> Bytes:
    """The grey level of each value of a sample."""
    black, white = (0, 2**bits - 1) if full else (16 << (bits - 8), 235 << (bits - 8))
    return np.clip(np.rint((np.arange(2**bits) - black) * 255 / (white - black)), 0, 255).astype(np.uint8)


def _rgb(frame: VideoFrame, full: bool) -> Bytes:
    from av.video.reformatter import ColorRange, Colorspace, Interpolation

    known = frame.colorspace not in {Colorspace.DEFAULT, 0, 2}  # which is RGB's own, and "not said"
    usual = Colorspace.ITU709 if frame.height >= HIGH_DEFINITION else Colorspace.ITU601
    exact = Interpolation.BILINEAR | Interpolation.ACCURATE_RND | Interpolation.BITEXACT | Interpolation.FULL_CHR_H_INT
    made = frame.reformat(
        format="rgb24",
        src_colorspace=frame.colorspace if known else usual,
        src_color_range=ColorRange.JPEG if full else ColorRange.MPEG,
        dst_color_range=ColorRange.JPEG,
        interpolation=exact,
    )
    return np.asarray(made.to_ndarray())
