"""What becomes of images that cannot be read."""

from __future__ import annotations

from enum import Enum


class OnBadImage(Enum):
    """What becomes of an image that cannot be read, is no whole image, or has another size than the others."""

    fail = "fail"
    skip = "skip"  # left out, and listed in `Frames.omitted`
