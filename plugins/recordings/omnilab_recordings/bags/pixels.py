"""Pixels of image messages."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from omnilab.api import Array, Bytes
from omnilab.errors import DataError
from omnilab_recordings.bags.decoding import ImageMessage
from omnilab_recordings.images.decoding import MOST_PIXELS, Decoder

# by ROS's names (sensor_msgs/image_encodings.hpp): samples a pixel and bytes a sample
ENCODINGS = {
    "mono8": (1, 1), "8UC1": (1, 1), "mono16": (1, 2), "16UC1": (1, 2),
    "rgb8": (3, 1), "bgr8": (3, 1), "8UC3": (3, 1), "rgba8": (4, 1), "bgra8": (4, 1), "8UC4": (4, 1),
    "yuv422": (2, 1), "uyvy": (2, 1), "yuv422_yuy2": (2, 1), "yuyv": (2, 1),
    "bayer_rggb8": (1, 1), "bayer_bggr8": (1, 1), "bayer_gbrg8": (1, 1), "bayer_grbg8": (1, 1),
}  # fmt: skip
REMARKS: Mapping[str, str] = {
    "mono16": "of images of 16 bits a sample the upper 8 are taken",
    "16UC1": "of images of 16 bits a sample (depth maps?) the upper 8 are taken",
    "8UC3": "images of encoding 8UC3, which does not say so, are taken for BGR",
    "8UC4": "images of encoding 8UC4, which does not say so, are taken for BGRA",
    **dict.fromkeys((name for name in ENCODINGS if name.startswith("bayer")), "Bayer patterns are interpolated"),
}
PACKED = {"jpeg", "jpg", "png", "webp", "bmp", "tiff"}  # what compressed data may be


def remark(image: ImageMessage) -> str | None:
    """What a user should know of how pixels of an encoding are read."""
    return None if image.compressed else REMARKS.get(image.encoding)


def unread(image: ImageMessage) -> str | None:
    """Why images of an encoding are not read, in words that follow "images of"; None if they are."""
    if image.compressed:
        words = image.encoding.lower().replace(";", " ").split()
        if "compressedDepth" in image.encoding or not any(word in PACKED for word in words):
            return f"format {image.encoding[:40]!r}, where {', '.join(sorted(PACKED))} are read"
        return None
    return (
        None
        if image.encoding in ENCODINGS
        else f"encoding {image.encoding[:40]!r}, where {', '.join(ENCODINGS)} are read"
    )


def pixels_of(image: ImageMessage, name: str, color: bool) -> Bytes:
    """Pixels, grey (H, W) or RGB (H, W, 3); DataError, with the image's name, if they cannot be had."""
    if (reason := unread(image)) is not None:
        raise DataError(f"{name} is of {reason}")
    if image.compressed:
        return Decoder(color).decode(bytes(image.data), name).pixels
    return _as_bytes(_samples(image, name), image.encoding)


def _samples(image: ImageMessage, name: str) -> Array:
    """Samples (H, W[, C]) as they were sent."""
    channels, size = ENCODINGS[image.encoding]
    if not 0 < image.height * image.width <= MOST_PIXELS:
        raise DataError(f"{name} is {image.width} x {image.height} pixels, and 1 to {MOST_PIXELS} are read")
    row = image.width * channels * size
    if image.step < row or len(image.data) < image.step * (image.height - 1) + row:
        raise DataError(
            f"{name} is truncated: {len(image.data)} bytes are too few for {image.width} x {image.height} pixels"
        )
    rows = np.lib.stride_tricks.as_strided(
        np.frombuffer(image.data, np.uint8), (image.height, row), (image.step, 1), writeable=False
    )
    samples = np.array(rows).view(f"{'>' if image.big_endian else '<'}u{size}")
    return (
        samples.reshape(image.height, image.width, channels)[..., 0]
        if channels == 1
        else samples.reshape(image.height, image.width, channels)
    )


def _as_bytes(samples: Array, encoding: str) -> Bytes:
    """Grey or RGB of 8 bits."""
    import cv2

    if samples.dtype.itemsize == 2:
        return (samples >> 8).astype(np.uint8)
    if encoding in {"mono8", "8UC1", "rgb8"}:
        return samples
    codes = {
        "bgr8": cv2.COLOR_BGR2RGB, "8UC3": cv2.COLOR_BGR2RGB, "rgba8": cv2.COLOR_RGBA2RGB,
        "bgra8": cv2.COLOR_BGRA2RGB, "8UC4": cv2.COLOR_BGRA2RGB,
        "yuv422": cv2.COLOR_YUV2RGB_UYVY, "uyvy": cv2.COLOR_YUV2RGB_UYVY,
        "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2, "yuyv": cv2.COLOR_YUV2RGB_YUY2,
        # OpenCV names a pattern by its second row's second and third pixel
        "bayer_rggb8": cv2.COLOR_BAYER_BG2RGB, "bayer_bggr8": cv2.COLOR_BAYER_RG2RGB,
        "bayer_gbrg8": cv2.COLOR_BAYER_GR2RGB, "bayer_grbg8": cv2.COLOR_BAYER_GB2RGB,
    }  # fmt: skip
    return np.asarray(cv2.cvtColor(samples, codes[encoding]), np.uint8)
