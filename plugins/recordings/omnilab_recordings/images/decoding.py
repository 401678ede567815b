"""Image files decoded: the one place where bytes become pixels."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes
from omnilab.errors import DataError


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
