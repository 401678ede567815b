"""Tiny image of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab_appearance.common.image_ops import channels_of, resized, side_by_side


@dataclass
class TinyImage:
    """The panorama averaged down to some pixels (Torralba et al., 2008): the cheapest baseline.

    Signatures are (N, rows, columns), and a rotation of the camera shifts the columns.
    """

    rows: int = setting(16, at_least=1, at_most=8192)  # of the tiny image
    columns: int = setting(32, at_least=1, at_most=8192)  # of the tiny image, over 360 degrees
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "poc_band"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Tiny images (N, rows, columns) of panoramas (N, H, W[, 3])."""
        tiny = resized(channels_of(images, self.color), self.rows, self.columns)
        return side_by_side(Signatures(tiny), self.color)
