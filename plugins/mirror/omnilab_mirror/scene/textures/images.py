"""Textures from picture files, which lie below the world file's folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.file_kinds import content_of
from omnilab_mirror.scene.nearby_files import file_below
from omnilab_mirror.scene.pictures import complaint
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
    return [file_below(s.file.parent, s.word("file")) for s in sections if s.value("kind") == "image"]


def _image(s: Section, file: str) -> Bytes:
    """RGB pixels (h, w, 3)."""
    try:
        data = content_of(file_below(s.file.parent, file), MAX_IMAGE_BYTES)
    except OSError as error:
        raise s.invalid("file", file, f"a picture that can be read ({error.strerror})") from None
    except ValueError as error:
        raise s.invalid("file", file, f"a picture below the world's folder ({error}); copy or save it there") from None
    if not data:
        raise s.invalid("file", file, f"a picture of 1 to {MAX_IMAGE_BYTES} bytes, not 0; save it again")
    problem = complaint(data, MAX_IMAGE_PIXELS)
    decoded = None if problem else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if decoded is None:
        raise s.invalid("file", file, f"a picture such as PNG or JPEG of at most {MAX_IMAGE_PIXELS} pixels ({problem})")
    return np.asarray(decoded[..., ::-1])
