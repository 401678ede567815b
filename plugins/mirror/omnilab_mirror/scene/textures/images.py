"""Textures from picture files, which lie below the world file's folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_mirror.scene.textures.canvas import Canvas, Painter
from omnilab_mirror.scene.world_yaml import Section

MAX_IMAGE_BYTES, MAX_IMAGE_PIXELS = 20_000_000, 40_000_000


def image(s: Section) -> Painter:
    """A picture `file`, below the world file's folder: stretched over each quad, or repeated every `tile_m` (x, y)."""
    file = s.word("file")
    picture = _image(s, file)
    tile = s.size("tile_m", 2) if "tile_m" in s else None

    def paint(canvas: Canvas) -> Floats:
        width, height = tile or canvas.size_m
        shape = tuple(
            max(1, round(n * a / b)) for n, a, b in zip(canvas.shape, (height, width), canvas.size_m, strict=True)
        )
        shrinks = shape[0] < picture.shape[0]
        one = cv2.resize(picture, shape[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        x, y = canvas.xy
        rows, columns = (y / height * shape[0]).astype(int) % shape[0], (x / width * shape[1]).astype(int) % shape[1]
        return np.asarray(one[::-1][rows, columns], np.float32)

    return paint


def images_of(sections: Iterable[Section]) -> list[Path]:
    """The files of those sections of `textures` that are images."""
    return [(s.file.parent / s.word("file")).resolve() for s in sections if s.value("kind") == "image"]


def _image(s: Section, file: str) -> Bytes:
    path, folder = (s.file.parent / file).resolve(), s.file.parent.resolve()
    if not path.is_relative_to(folder):
        raise s.invalid("file", file, f"a picture below the world's folder {folder}; copy it there")
    try:
        size = path.stat().st_size
        data = path.read_bytes() if size <= MAX_IMAGE_BYTES else b""
    except OSError as error:
        raise s.invalid("file", file, f"a picture that can be read ({error.strerror}: {path})") from None
    if not data:
        raise s.invalid("file", file, f"a picture of 1 to {MAX_IMAGE_BYTES} bytes, not {size}; scale it down")
    try:
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # more pixels than OpenCV takes
        decoded = None
    if decoded is None or decoded.size > 3 * MAX_IMAGE_PIXELS:
        raise s.invalid("file", file, f"a picture such as PNG or JPEG of at most {MAX_IMAGE_PIXELS} pixels")
    return np.asarray(decoded[..., ::-1])
